"""Files of readings as people and tracker software write them, and the numbers that are in them."""

import csv
import io
from dataclasses import dataclass

from jointstiff.schemas.imports import ImportAnswer, ImportFault, ImportOptions, ImportRequest
from jointstiff.service.importing.reading import Understood, understand_files
from jointstiff.service.importing.source_files import SourceFile
from jointstiff.service.resources.imports import import_files
from jointstiff.solver.mechanics.robot import Robot

MM = {"length": "mm", "angle": "deg", "force": "N"}
DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t", "whitespace": " "}

CAMPAIGN = """\
# cell 3, dead weight, 2026-11-20
label;J1 [deg];J2 [deg];J3 [deg];Fx [N];Fy [N];Fz [N];P10 unloaded x [mm];\
P10 unloaded y [mm];P10 unloaded z [mm];P10 loaded x [mm];P10 loaded y [mm];P10 loaded z [mm]
c01;10.5;-20.25;30;0;0;-1471.5;1245.7134;-310.1127;239.2014;1245.6021;-310.1098;237.9853
c02;-15;-35.125;42.75;0;0;-1471.5;1102.5518;402.9017;318.4406;1102.4127;402.8613;316.8891
c03;0.5;-50;61.0625;0;0;-1471.5;1310.0042;12.4450;87.3391;1309.8717;12.4462;85.9120
"""

CAMPAIGN_NUMBERS = [
    (
        "c01", [10.5, -20.25, 30.0], (0.0, 0.0, -1471.5),
        {"P10": ((1245.7134, -310.1127, 239.2014), (1245.6021, -310.1098, 237.9853))},
    ),
    (
        "c02", [-15.0, -35.125, 42.75], (0.0, 0.0, -1471.5),
        {"P10": ((1102.5518, 402.9017, 318.4406), (1102.4127, 402.8613, 316.8891))},
    ),
    (
        "c03", [0.5, -50.0, 61.0625], (0.0, 0.0, -1471.5),
        {"P10": ((1310.0042, 12.4450, 87.3391), (1309.8717, 12.4462, 85.9120))},
    ),
]  # fmt: skip

JOINTS = """\
label,J1 [deg],J2 [deg],Fx [N],Fy [N],Fz [N]
c01,10.5,-20.25,0,0,-1471.5
c02,-15,-35.125,0,0,-1471.5
"""

POINTS = """\
c01_P10_unloaded;1245.7134;-310.1127;239.2014
c01_P10_loaded;1245.6021;-310.1098;237.9853
c02_P10_unloaded;1102.5518;402.9017;318.4406
c02_P10_loaded;1102.4127;402.8613;316.8891
"""

READ_POINTS = {
    ("c01", "P10", "unloaded"): (1245.7134, -310.1127, 239.2014),
    ("c01", "P10", "loaded"): (1245.6021, -310.1098, 237.9853),
    ("c02", "P10", "unloaded"): (1102.5518, 402.9017, 318.4406),
    ("c02", "P10", "loaded"): (1102.4127, 402.8613, 316.8891),
}


BARE = CAMPAIGN.replace(" [deg]", "").replace(" [N]", "").replace(" [mm]", "")
"""A table without units."""

HUNG = """\
label;J1 [deg];mass [kg];P10 dx [mm];P10 dy [mm];P10 dz [mm]
c01;10.5;150;0.1;0.2;-1.25
c02;-15;150;0.1;0.25;-1.5
"""

STATES = """\
label target state x[mm] y[mm] z[mm]
c01 P10 unloaded 1 2 3.5
c01 P10 Loaded 1.5 2 3
"""

GROUPED = """\
Punkt;Achse;;P10 ohne Last;;;P10 mit Last;;
;1;2;x;y;z;x;y;z
c01;10.5;-20;1;2;3;1;2;2.5
"""

SPATIAL_ANALYZER = """\
// SpatialAnalyzer
// FRAME = A::R0
// AXES = CARTESIAN: X,  Y,  Z (mm)
Collection,  Group,  Point,  X,  Y,  Z
Unloaded, c01, P10, 1.0, 2.0, 4.5
Loaded, c01, P10, 1.0, 2.0, 4.0
"""

LEICA = """\
"Time","Name","X  [mm]","Y  [mm]","Z  [mm]","U(95)  [mm]",
"2026-11-20 10:00:01","c01_P10_u",1.5,2.25,3.5,0.03,
"2026-11-20 10:00:09","c01_P10_l",1.5,2.25,3.1,0.04,
"""

TRACKER = """\
Name,X  [mm],Y  [mm],Z  [mm],U(95) X  [mm],U(95) Y  [mm],U(95) Z  [mm],Target,Pressure  [mBar],Time,Delete,
c01_P10_unloaded,1245.7134,-310.1127,239.2014,0.031,0.012,0.0,CCR 1.5in,1013.2,'08.11.2022 16:10:28.353,False,
c01_P10_loaded,1245.6021,-310.1098,237.9853,0.031,0.012,0.0,CCR 1.5in,1013.2,'08.11.2022 16:11:28.353,False,
c02_P10_unloaded,1102.5518,402.9017,318.4406,0.031,0.012,0.0,CCR 1.5in,1013.2,'08.11.2022 16:12:28.353,False,
c02_P10_loaded,1102.4127,402.8613,316.8891,0.031,0.012,0.0,CCR 1.5in,1013.2,'08.11.2022 16:13:28.353,False,
"""

POSES = """\
name,J1 [deg],J2 [deg],P1 unloaded x [mm],P1 unloaded y [mm],P1 unloaded z [mm],dx,dy,dz
c01,10,20,1000,200,300,0.5,-0.25,0.125
c02,30,40,900,400,350,-0.5,0.75,0
"""


@dataclass(frozen=True)
class Dialect:
    """How to write a table."""

    delimiter: str = "semicolon"
    mark: str = "."
    encoding: str = "utf-8"
    end: str = "\n"
    quote: bool = False

    def write(self, rows: list[list[str]]) -> bytes:
        """Rows of cells, numbers in them with a point, as a file."""
        output = io.StringIO()
        quoting = csv.QUOTE_ALL if self.quote else csv.QUOTE_MINIMAL
        writer = csv.writer(
            output, delimiter=DELIMITERS[self.delimiter], lineterminator=self.end, quoting=quoting
        )
        for row in rows:
            writer.writerow([cell.replace(".", self.mark) if _is_number(cell) else cell for cell in row])
        return output.getvalue().encode(self.encoding)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def read(*files: tuple[str, str | bytes], **options: object) -> Understood:
    """Import named texts; the first fault is raised."""
    understood = understand_files(sources_of(*files), ImportOptions.model_validate(options))
    if understood.faults:
        raise understood.faults[0]
    return understood


def sources_of(*files: tuple[str, str | bytes]) -> list[SourceFile]:
    """Return named texts as files."""
    return [
        SourceFile(name, content if isinstance(content, bytes) else content.encode())
        for name, content in files
    ]


def points_of(imported: Understood) -> dict[tuple[str, str, str], tuple[float, ...]]:
    """All positions and deflections that were read."""
    return {
        (one.label, target, state): point.vector
        for one in imported.observations
        for target, states in one.points.items()
        for state, point in states.items()
    }


def values_of(imported: Understood) -> dict[tuple[str, str], tuple[float, ...]]:
    """All else."""
    return {
        (one.label, quantity.kind): value.vector
        for one in imported.observations
        for quantity, value in one.values.items()
        if quantity.target is None
    }


def answered(*files: tuple[str, str | bytes], robot: Robot | None = None, **options: object) -> ImportAnswer:
    """Return what is made of files, with a load point and encoders; the faults if `show_faults` is set."""
    stated = {"encoders": "motor", "load_point": (0.0, 0.0, 120.0), **options}
    return import_files(sources_of(*files), ImportRequest.model_validate(stated), robot)


def refusals(*files: tuple[str, str | bytes], robot: Robot | None = None, **options: object) -> list[str]:
    """Return what is said of each fault of files: place, reason, remedy, and the option that corrects it."""
    answer = answered(*files, robot=robot, **{**options, "show_faults": True})
    return [told(each) for each in answer.faults]


def told(fault: ImportFault) -> str:
    """Return a fault in one line, such as `a.csv:4:1: the name is empty; fill in the cell`."""
    parts = (fault.file, fault.line, fault.column)
    place = ":".join(str(part) for part in parts if part is not None)
    option = f" [{fault.option}]" if fault.option else ""
    return f"{place}{': ' if place else ''}{fault.reason}; {fault.remedy}{option}"


def numbers_of(answer: ImportAnswer) -> list[tuple[object, ...]]:
    """Return each observation of a set: label, joints, force, and by target both positions."""
    assert answer.measurement_set is not None
    return [
        (
            one.label,
            [*one.joints],
            one.force,
            {each.target: (each.unloaded, each.loaded) for each in one.readings},
        )
        for one in answer.measurement_set.observations
    ]


def meanings_of(answer: ImportAnswer, file: int = 0) -> list[str]:
    """Return the meanings of the columns of a file, such as `joint 1 [deg]?`; ? stands for a guess."""
    columns = answer.files[file].columns
    return [f"{c.meaning}{f' [{c.unit}]' if c.unit else ''}{'?' * c.guessed}" for c in columns]
