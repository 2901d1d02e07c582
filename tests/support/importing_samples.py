"""Files of readings as people and tracker software write them, and how a test imports them."""

from jointstiff.schemas.imports import ImportAnswer, ImportRequest
from jointstiff.service.imports.answer import import_files
from jointstiff.service.imports.formats import SourceFile
from jointstiff.service.resources.known_robots import catalogue_robots
from jointstiff.solver.mechanics.robot import KnownRobot

STATED = {"encoders": "motor", "load_point": (0.0, 0.0, 120.0)}

CAMPAIGN = """\
# cell 3, dead weight, 2026-11-20
label;J1 [deg];J2 [deg];J3 [deg];Fx [N];Fy [N];Fz [N];P10 unloaded x [mm];\
P10 unloaded y [mm];P10 unloaded z [mm];P10 loaded x [mm];P10 loaded y [mm];P10 loaded z [mm]
c01;10.5;-20.25;30;0;0;-1471.5;1245.7134;-310.1127;239.2014;1245.6021;-310.1098;237.9853
c02;-15;-35.125;42.75;0;0;-1471.5;1102.5518;402.9017;318.4406;1102.4127;402.8613;316.8891
c03;0.5;-50;61.0625;0;0;-1471.5;1310.0042;12.4450;87.3391;1309.8717;12.4462;85.9120
"""
"""A table with the documented headers."""

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

LONG = """\
label;J1 [deg];Fx [N];Fy [N];Fz [N];target;state;x [mm];y [mm];z [mm]
c01;10.5;0;0;-1471.5;P10;unloaded;1.5;2.25;3.125
c01;10.5;0;0;-1471.5;P10;loaded;1.75;2.5;2.125
c01;10.5;0;0;-1471.5;P11;unloaded;4.5;5.25;6.125
c01;10.5;0;0;-1471.5;P11;loaded;4.75;5.5;5.125
c02;-7.25;0;0;-1471.5;P10;unloaded;7.5;8.25;9.125
c02;-7.25;0;0;-1471.5;P10;loaded;7.75;8.5;8.125
c02;-7.25;0;0;-1471.5;P11;unloaded;10.5;11.25;12.125
c02;-7.25;0;0;-1471.5;P11;loaded;10.75;11.5;11.125
"""
"""A table with a row for each target and state."""


def sources_of(*files: tuple[str, str | bytes]) -> list[SourceFile]:
    """Return named texts as files."""
    return [
        SourceFile(name, content if isinstance(content, bytes) else content.encode())
        for name, content in files
    ]


def arm(name: str) -> KnownRobot:
    """Return an arm of the catalogue."""
    return next(each for each in catalogue_robots() if each.name == name)


def answered(
    *files: tuple[str, str | bytes], robot: KnownRobot | None = None, **mapping: object
) -> ImportAnswer:
    """Return the answer of an import, with encoders and load point unless the mapping states others."""
    request = ImportRequest.model_validate({"mapping": STATED | mapping})
    return import_files(sources_of(*files), request, robot)


def numbers_of(answer: ImportAnswer) -> list[tuple[object, ...]]:
    """Return each observation of a set: label, joints, force, and by target both positions."""
    assert answer.measurement_set is not None, (answer.questions, answer.faults)
    return [
        (
            one.label,
            [*one.joints],
            one.force,
            {each.target: (each.unloaded, each.loaded) for each in one.readings},
        )
        for one in answer.measurement_set.observations
    ]
