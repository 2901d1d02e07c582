"""Campaigns as Python programs make them: from arrays, files or messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import inf, nan
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

from pydantic import PrivateAttr

from jointstiff.schemas import run as messages
from jointstiff.schemas.measurement import MeasurementSetDocument
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Run
from jointstiff.service.library import robots
from jointstiff.service.library.robots import plain_fields
from jointstiff.service.problems import as_campaign_error, require_folder
from jointstiff.service.process import one_thread
from jointstiff.service.resources.documents import parse_document, read_campaign
from jointstiff.solver.errors import MeasurementError

_CAUSES_OF_LONG_DEFLECTIONS: Final = frozenset(
    (
        "observations_out_of_order",
        "deflection_implausibly_large",
        "length_unit_suspect",
        "target_off_model",
    )
)
"""Codes of findings about the whole set that state why deflections are too long."""

if TYPE_CHECKING:
    import numpy.typing as npt

    from jointstiff.service.conversion.prepared import PreparedSet
    from jointstiff.service.conversion.units import AnyUnits
    from jointstiff.service.resources.inputs import InMemoryInputs
    from jointstiff.solver.mechanics.measurements import Measurements

    Numbers = npt.ArrayLike | Mapping[str, Any]


class Campaign(messages.Campaign):
    """Campaign: a robot, a measurement set of the robot, and the options of a run."""

    _assumed: tuple[str, ...] = PrivateAttr(default=())  # what was assumed without a statement

    @classmethod
    def from_message(cls, campaign: messages.Campaign) -> Campaign:
        """Return a campaign message as an object of this class, which can be saved and checked."""
        return campaign if isinstance(campaign, cls) else cls.model_validate(dict(campaign))

    @classmethod
    def from_arrays(
        cls,
        robot: object,
        joints: Numbers,
        forces: Numbers | None = None,
        *,
        moments: Numbers | None = None,
        load_point: Numbers | None = None,
        unloaded: Numbers | None = None,
        loaded: Numbers | None = None,
        unloaded_after: Numbers | None = None,
        deflections: Numbers | None = None,
        directions: Numbers | None = None,
        targets: Sequence[str] | Mapping[str, npt.ArrayLike] | None = None,
        labels: Sequence[str] | None = None,
        units: AnyUnits = None,
        sigma: float | None = None,
        encoders: str | None = None,
        name: str = "readings from arrays",
        run: RunOptions | Mapping[str, Any] | None = None,
        **header: object,
    ) -> Campaign:
        """Make a campaign from arrays: N observations of a robot with n joints, T targets.

        Arrays may be lists, numpy arrays, or columns of pandas or polars without names; `jointstiff.read`
        reads a data frame by its columns. Give `unloaded` and
        `loaded` positions, or `deflections`; with `directions`, deflections are lengths along them, as of a
        dial gauge. Unloaded positions alone are for runs with `weight`, which need no force. A target that
        was not read is NaN.

        Args:
            robot: anything that `jointstiff.robot` takes, such as the name of an arm of the catalogue.
            joints: (N, n) joint values as the controller shows them.
            forces: (N, 3), or (3,) for all observations: forces on the robot, axes of R0.
            moments: (N, 3) or (3,): moments about the load point.
            load_point: (3,) or (N, 3): point where the force acts, flange frame.
            unloaded: (N, T, 3) positions in R0 without load; (N, 3) of one target; or a dictionary of (N, 3)
                by target.
            loaded: positions under load, in the same form as `unloaded`.
            unloaded_after: positions after the load was removed, in the same form; NaN where not read again.
            deflections: loaded minus unloaded positions, in the same form; with `directions` (N, T) lengths.
                Deflections need the places of the targets.
            directions: (3,), (T, 3) or (N, T, 3): directions of the lengths, axes of R0.
            targets: names of the targets, or their places (3,) in the flange frame by name.
            labels: (N,) names of the observations; c01, c02, … if absent.
            units: units of all numbers above and of `sigma`, such as "m, rad, kN, kN.m"; default: mm, deg, N
                and N.m.
            sigma: standard uncertainty of one coordinate of one reading; estimated from the residuals if
                absent.
            encoders: encoders that close the position loop, `motor` or `secondary`; `motor` is assumed, and
                the first screen of a run says so.
            name: name of the measurement set.
            run: options of its runs, such as {"method": "complete_pose"}.
            header: other fields of a measurement set, such as `frame`, `noise` or `operator`.

        Raises:
            CampaignError: an array has a wrong shape, or a length seems to be in another unit; its `problem`
                states the array, the place and the remedy.
        """
        from jointstiff.service.conversion.arrays import convert_arrays
        from jointstiff.service.conversion.units import complete_units

        described = robots.robot(robot)
        with as_campaign_error(""):
            noise = {} if sigma is None else {"noise": {"sigma": _read_sigma(sigma)}}
            _refuse_no_targets(targets)
            stated_units = complete_units(units)
            arrays = {
                "joints": joints,
                "forces": forces,
                "moments": moments,
                "load_point": load_point,
                "unloaded": unloaded,
                "loaded": loaded,
                "unloaded_after": unloaded_after,
                "deflections": deflections,
                "directions": directions,
                "targets": targets,
                "labels": labels,
            }
            readings = convert_arrays(arrays)
        document = {
            "name": name,
            "encoders": encoders or "motor",
            **noise,
            **plain_fields(header),
            "units": stated_units,
            **readings,
        }
        options = run if isinstance(run, Mapping) else {} if run is None else plain_fields(run)
        campaign = cls(
            robot=described,
            measurement_set=parse_document(document, MeasurementSetDocument),
            run=parse_document(options, RunOptions),
        )
        if encoders is None:
            campaign._assumed = ("motor encoders",)
        _refuse_long_deflections(campaign)
        return campaign

    @classmethod
    def read(cls, path: str | PathLike[str]) -> Campaign:
        """Read a campaign file.

        Raises:
            CampaignError: the file is not a campaign.
            OSError: the file cannot be read.
        """
        return cls.from_message(read_campaign(path))

    def check(self) -> None:
        """Check that robot and readings can be used together.

        Raises:
            CampaignError: robot or readings cannot be used.
        """
        _prepare(self)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the campaign to a JSON file, which all commands and `Client` accept.

        Raises:
            CampaignError: the folder of the file is missing.
        """
        text = self.model_dump_json(indent=1, exclude_none=True, exclude_defaults=True)
        require_folder(Path(path)).write_text(f"{text}\n", encoding="utf-8")

    def __repr__(self) -> str:
        """Return name, robot and number of observations in one line."""
        observations = self.measurement_set.observations
        targets = {reading.target for each in observations for reading in each.readings}
        return (
            f"<Campaign '{self.measurement_set.name}' of '{self.robot.name}': {len(observations)} "
            f"observations, {len(targets)} targets, {self.measurement_set.encoders} encoders>"
        )

    __str__ = __repr__


@one_thread()
def add_campaign(inputs: InMemoryInputs, campaign: messages.Campaign, place: str = "") -> str:
    """Prepare a campaign as an input of work; return the id of its measurement set.

    `place` is put before the places in errors, such as `campaigns[3].`.

    Raises:
        CampaignError: robot or readings cannot be used.
    """
    with as_campaign_error(f"{place}robot"):
        robot = robots.prepare_once(campaign.robot)
    with as_campaign_error(f"{place}measurement_set"):
        return inputs.add_set(campaign.measurement_set, robot)


def _prepare(campaign: Campaign) -> PreparedSet:
    """Return the measurement set of a campaign as it is prepared for a run.

    Raises:
        CampaignError: robot or readings cannot be used.
    """
    from jointstiff.service.resources.inputs import InMemoryInputs

    inputs = InMemoryInputs()
    return inputs.measured(add_campaign(inputs, campaign), "measurement_set")


def _read_sigma(sigma: object) -> float:
    """Return the argument `sigma` of `from_arrays` as a number.

    Raises:
        MeasurementError: it is no positive number.
    """
    try:
        number = float(cast("Any", sigma))
    except (TypeError, ValueError):
        number = nan
    if not 0.0 < number < inf:
        raise MeasurementError(
            f"`sigma` is {sigma!r}, but must be a positive number",
            where="sigma",
            remedy="give the standard uncertainty of one coordinate, such as 0.02 in mm, or leave it out: "
            "it is then estimated from the residuals",
        )
    return number


def _refuse_no_targets(targets: object) -> None:
    """Raise a `MeasurementError` if the argument `targets` of `from_arrays` has neither names nor places."""
    if not isinstance(targets, Iterable | None) or isinstance(targets, str):
        raise MeasurementError(
            f"`targets` is {targets!r}, but must be a list of names, or a dictionary of places",
            where="targets",
            remedy="give the names of the targets, such as ['P1', 'P2'], or their places in the flange "
            "frame, such as {'P1': (0, 0, 100)}",
        )


_LARGE_DEFLECTION: Final = 1.0
"""Deflection beyond which loaded and unloaded readings are of different postures or units [m]."""


def _refuse_long_deflections(campaign: Campaign) -> None:
    """Refuse loaded readings that are too far from the unloaded readings, with the cause.

    Raises:
        CampaignError: a deflection is too long for an arm; or robot or readings cannot be used.
    """
    import numpy as np

    measurements = _convert_campaign(campaign)
    lengths = np.linalg.norm(measurements.deflection, axis=2)  # (rows, targets) [m]
    if lengths.max() <= _LARGE_DEFLECTION:
        return
    error = _find_cause_of_long_deflection(campaign)
    if error is None:
        row, target = np.unravel_index(int(lengths.argmax()), lengths.shape)
        error = MeasurementError(
            f"target '{measurements.targets[target]}' moved by {lengths.max():.4g} m under load in "
            f"'{measurements.labels[row]}'; up to {_LARGE_DEFLECTION:g} m is plausible",
            where="loaded",
            remedy="check that unloaded and loaded readings are of the same posture and target, in the same "
            "frame and unit; a campaign file may have greater deflections",
        )
    with as_campaign_error(""):
        raise error


def _convert_campaign(campaign: Campaign) -> Measurements:
    """Return the readings of a campaign in SI units and R0; errors name the part of the campaign.

    Raises:
        CampaignError: robot or readings cannot be used.
    """
    from jointstiff.service.conversion.prepared import convert_readings, resolve_stated_frame

    document = campaign.measurement_set
    with as_campaign_error("robot"):
        robot = robots.prepare_once(campaign.robot).robot
    with as_campaign_error("measurement_set"):
        _, measurements = convert_readings(document, robot, resolve_stated_frame(document))
    return measurements


def _find_cause_of_long_deflection(campaign: Campaign) -> MeasurementError | None:
    """Return the error that names the mistake in all readings, such as a wrong unit, if a check finds one."""
    for finding in _prepare(campaign).warnings:
        if finding.code in _CAUSES_OF_LONG_DEFLECTIONS and finding.where is None:
            return MeasurementError(finding.message, where="loaded", remedy=finding.remedy)
    return None


def extract_run_options(run: Run) -> RunOptions:
    """Return the options of a run as a campaign file has them: its request without ids of other objects."""
    options = run.request.model_dump(exclude={"measurement_set_id", "variant_of"}, exclude_unset=True)
    return RunOptions.model_validate(options)
