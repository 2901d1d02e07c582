"""Results of a geometry: axes, base frame, wrist centre, targets and the identified model. SI units."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jointstiff.schemas.assessment import Assessment, ResultSummary
from jointstiff.schemas.fields import (
    Dimensionless,
    Message,
    Metres,
    MixedSquares,
    Name,
    Point,
    Radians,
    Square3,
    SquareMetres,
    SquareRadians,
    StatedUnit,
)
from jointstiff.schemas.finding import Finding
from jointstiff.schemas.job import Result
from jointstiff.schemas.robot import DhRow, RobotDocument

Square6 = Annotated[
    list[Annotated[list[float], Field(min_length=6, max_length=6)]], Field(min_length=6, max_length=6)
]


class Rigid(Message):
    """Transform of coordinates x to another frame: ``rotation x + translation``."""

    rotation: Dimensionless[Square3] = Field(description="Rotation matrix, row by row. Dimensionless.")
    translation: Metres[Point]


class AxisPlace(Message):
    """An axis in one frame, at model angle zero of all joints."""

    point: Metres[Point] = Field(description="Point on the axis.")
    direction: Dimensionless[Point] = Field(
        description="Unit vector along the axis; positive rotation by the right-hand rule."
    )
    point_covariance: SquareMetres[Square3 | None] = Field(
        description="Covariance of the axis's position at `point`, singular along the axis; null if not "
        "determined."
    )
    direction_covariance: SquareRadians[Square3 | None] = Field(
        description="Covariance of the unit vector; null if not determined."
    )


class IdentifiedAxis(Message):
    """One axis of the model."""

    name: Name = Field(description="Name of the model's joint.")
    tracker: AxisPlace = Field(description="Axis in the tracker's frame.")
    base: AxisPlace = Field(description="Axis in R0, including the uncertainty of R0.")
    position_uncertainty: Metres[float | None] = Field(
        description="Largest standard uncertainty across the axis at `point`, tracker's frame."
    )
    direction_uncertainty: Radians[float | None] = Field(
        description="Largest standard uncertainty of the direction, tracker's frame."
    )


class SweptTarget(Message):
    """One target of a sweep."""

    name: Name
    readings: int
    radius: Metres[float | None] = Field(
        description="Radius: distance from the axis; null in a sweep that turns two axes."
    )
    radial_rms: Metres[float | None] = Field(
        description="Root mean square of the radial residuals; of those across the axis in a sweep "
        "that turns "
        "two. Null without a reading."
    )
    axial_rms: Metres[float | None] = Field(description="Root mean square of the residuals along the axis.")


class SweepEvidence(Message):
    """One sweep, fitted by itself."""

    joint: Name = Field(description="Name of the joint, as posted.")
    turned: list[Name] = Field(description="Names of the model's joints that turn.")
    positions: int
    arc: Radians[float] = Field(description="Arc covered by the readings.")
    targets: list[SweptTarget]
    angle_scale: float = Field(
        description="Measured rotation of the joint over that of controller and joint map. Dimensionless."
    )
    angle_deviation: Radians[float | None] = Field(
        description="Root mean square difference between the angles from the readings and the controller's; "
        "null if the controller's are used."
    )
    variance_factor: float = Field(
        description="χ²/dof of this sweep: 1 on average if sigma is right. Dimensionless."
    )


class PoseEvidence(Message):
    """Unknowns that the poses determine."""

    positions: int
    unknowns: int = Field(description="Number of unknowns: four per axis and three per target.")
    determined: int = Field(description="Number of independent combinations that the poses determine.")
    only_together: list[list[str]] = Field(
        description="Unknowns of each combination that is not determined; they keep their nominal values."
    )
    rms_residual: Metres[float] = Field(description="Root mean square residual of a coordinate.")
    held_out_rms: Metres[float | None] = Field(
        description="Root mean square error of a coordinate of held-out poses, by five-fold "
        "cross-validation; null if the other poses do not determine the geometry."
    )


class GeometryGoodness(Message):
    """Goodness of fit of one robot model to all readings."""

    sigma: Metres[float] = Field(
        description="Standard uncertainty of a coordinate, from which all others follow; for an instrument, "
        "the root mean square over the readings."
    )
    sigma_source: Literal["stated", "residuals"]
    degrees_of_freedom: int
    variance_factor: float = Field(
        description="χ²/dof: 1 on average if the stated sigma is right; 1 if it comes from the residuals. "
        "Dimensionless."
    )
    agreement_probability: float | None = Field(
        description="p-value of one robot model for all sweeps. Small: fit them one by one."
    )
    controller_probability: float | None = Field(
        description="p-value of the controller's angles. Not small: `angles` = `controller` gives the better "
        "estimate."
    )


class BaseFrameResult(Message):
    """R0 as the tracker sees it."""

    by: Literal["nominal", "axes"]
    transform_tracker_to_base: Rigid
    covariance: MixedSquares[Square6 | None] = Field(
        description="Covariance of a small motion (δ, φ) in R0, ``y = (1 + [φ]×)(R x + t) + δ``: "
        "translation, "
        "then rotation; null if not determined."
    )


class WristCentre(Message):
    """The wrist centre by one estimate."""

    tracker: Metres[Point]
    tracker_covariance: SquareMetres[Square3]
    base: Metres[Point] = Field(description="Point in R0.")
    base_covariance: SquareMetres[Square3] = Field(description="Covariance, including the uncertainty of R0.")


class WristEstimate(WristCentre):
    """One estimate of the wrist centre."""

    way: Literal["sphere", "axes", "trilateration"]
    weight: float = Field(description="Weight in the combined centre, over three directions. Dimensionless.")


class WristDistance(Message):
    """Two estimates side by side."""

    first: Literal["sphere", "axes", "trilateration"]
    second: Literal["sphere", "axes", "trilateration"]
    distance: Metres[float]
    probability: float = Field(description="p-value of the drift.")


class WristResult(Message):
    """Wrist centre, and the test of the last three axes for intersection."""

    estimates: list[WristEstimate]
    combined: WristCentre = Field(description="Weighted mean of the estimates, weights by their information.")
    distances: list[WristDistance]
    posture: Radians[list[float]] = Field(
        description="Model angles at which the centre is given; those of the wrist do not matter."
    )
    miss_distance: Metres[float] = Field(
        description="Largest distance of one of the three axes from the point nearest to them."
    )
    miss_uncertainty: Metres[float]
    miss_probability: float = Field(description="p-value of the hypothesis that the axes intersect.")
    decoupled_method: bool = Field(
        description="True if the decoupled method applies: the axes miss each other by no more than 0.5 mm."
    )


class FlangeTarget(Message):
    """A target in the flange frame."""

    name: Name
    position: Metres[Point]
    covariance: SquareMetres[Square3 | None] = Field(
        description="Standard uncertainty; null if not determined."
    )


class LinkComparison(Message):
    """A length or an angle of the robot, nominal beside identified."""

    quantity: Literal["a", "alpha", "beta", "d", "theta"] = Field(
        description="Denavit-Hartenberg parameter; beta is the second angle of axes meant to be parallel."
    )
    joint: Name = Field(description="Joint of the axis, or of the first of two neighbours.")
    unit: Literal["m", "rad"] = Field(description="Unit of the numbers.")
    nominal: StatedUnit[float]
    identified: StatedUnit[float]
    difference: StatedUnit[float] = Field(description="Identified minus nominal value.")
    standard_uncertainty: StatedUnit[float | None] = Field(
        description="Standard uncertainty of the identified value; null if not determined."
    )


class NearlyParallel(Message):
    """Neighbouring axes that are nearly parallel."""

    joint: Name = Field(description="Joint of the first axis.")
    angle: Radians[float]
    made_parallel: bool = Field(description="True if the table treats the axes as parallel.")


class IdentifiedDh(Message):
    """The identified model as a table: ``flange to R0 = base · T1 … Tn · tool``."""

    convention: Literal["standard", "modified"]
    rows: list[DhRow]
    base: Rigid = Field(description="Transform from frame 0 to R0.")
    tool: Rigid = Field(description="Transform from the flange frame to frame n.")
    parallel: list[NearlyParallel]
    deviation: Metres[float] = Field(
        description="Largest distance between the table's flange and the identified model's, over 200 random "
        "postures: the effect of treating axes as parallel."
    )


class Drift(Message):
    """Motion of tracker and robot against each other between two readings of the base targets."""

    transform_after_to_before: Rigid = Field(
        description="Transform that corrects the drift in later readings."
    )
    displacement: Metres[Point] = Field(
        description="Translation of the middle of the flange targets, tracker's frame."
    )
    displacement_covariance: SquareMetres[Square3]
    rotation: Radians[Point] = Field(description="Rotation vector, tracker's frame.")
    probability: float = Field(description="p-value of the drift.")
    deformation_probability: float = Field(description="p-value of the residuals.")
    significant: bool
    moved_targets: list[Name] = Field(description="Base targets that moved relative to the others.")


class GeometryResult(Result):
    """The identified robot."""

    assessment: Assessment = Field(description="Verdict from the findings; notes are no reasons.")
    axes: list[IdentifiedAxis]
    sweeps: list[SweepEvidence] = Field(description="Sweeps; empty for poses.")
    fit: Literal["one_by_one", "together"] | None = Field(
        description="Fit that gave the axes from sweeps: one_by_one also if `together` was requested and the "
        "sweeps disagree (finding `sweeps_disagree`). Null for poses."
    )
    poses: PoseEvidence | None = Field(description="Calibration from poses; null for sweeps.")
    goodness: GeometryGoodness
    base_frame: BaseFrameResult
    wrist: WristResult | None = Field(description="Wrist centre; null if there is none, see `no_wrist`.")
    no_wrist: str | None = Field(description="Reason why there is no wrist centre.")
    targets: list[FlangeTarget]
    flange: Literal["nominal", "axes", "targets"] = Field(description="Definition of the flange frame.")
    links: list[LinkComparison] = Field(description="Link parameters; empty without a nominal model.")
    robot: RobotDocument = Field(description="Identified model as a robot document, ready to be posted.")
    dh: list[IdentifiedDh]
    drift: Drift | None = Field(
        description="Drift of the base targets; null unless they were read before and after."
    )
    findings: list[Finding]

    @property
    def summary(self) -> ResultSummary:
        """Excerpt for listings."""
        return ResultSummary(
            verdict=self.assessment.verdict,
            warning_count=sum(finding.weight != "use" for finding in self.findings),
        )
