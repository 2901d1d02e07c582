"""What a geometry says: axes, base frame, wrist centre, targets and the identified model. SI units."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

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
from jointstiff.schemas.robot import DhRow, RobotDocument

Square6 = Annotated[
    list[Annotated[list[float], Field(min_length=6, max_length=6)]], Field(min_length=6, max_length=6)
]


class Rigid(Message):
    """Coordinates x in one frame become ``rotation x + translation`` in another."""

    rotation: Dimensionless[Square3] = Field(description="Row by row. Dimensionless.")
    translation: Metres[Point]


class AxisPlace(Message):
    """An axis in one frame, at model angle zero of all joints."""

    point: Metres[Point] = Field(description="A point on it.")
    direction: Dimensionless[Point] = Field(description="Unit vector, positive rotation by the right hand.")
    point_covariance: SquareMetres[Square3 | None] = Field(
        description="Of where the axis passes at `point`, singular along it; null if it is not determined."
    )
    direction_covariance: SquareRadians[Square3 | None] = Field(
        description="Of the unit vector; null if it is not determined."
    )


class IdentifiedAxis(Message):
    """One axis of the model."""

    name: Name = Field(description="Of the model's joint.")
    tracker: AxisPlace = Field(description="In the tracker's frame.")
    base: AxisPlace = Field(description="In R0, the uncertainty of R0 included.")
    position_uncertainty: Metres[float | None] = Field(
        description="Greatest standard uncertainty across the axis at `point`, tracker's frame."
    )
    direction_uncertainty: Radians[float | None] = Field(
        description="Greatest standard uncertainty of the direction, tracker's frame."
    )


class SweptTarget(Message):
    """One target of a sweep."""

    name: Name
    readings: int
    radius: Metres[float | None] = Field(
        description="Distance from the axis; null in a sweep that turns two axes."
    )
    radial_rms: Metres[float | None] = Field(
        description="Root mean square of the residuals towards the axis; across the axis in a sweep that "
        "turns two. Null without a reading."
    )
    axial_rms: Metres[float | None] = Field(description="The same along the axis.")


class SweepEvidence(Message):
    """One sweep, fitted by itself."""

    joint: Name = Field(description="As it was posted.")
    turned: list[Name] = Field(description="Joints of the model that turn.")
    positions: int
    arc: Radians[float] = Field(description="Angle that the readings cover.")
    targets: list[SweptTarget]
    angle_scale: float = Field(
        description="How far the joint turned over how far controller and joint map say. Dimensionless."
    )
    angle_deviation: Radians[float | None] = Field(
        description="Root mean square of the angle from the readings less the controller's; null where the "
        "controller's are taken."
    )
    variance_factor: float = Field(
        description="χ²/dof of this sweep: 1 on average if sigma is right. Dimensionless."
    )


class PoseEvidence(Message):
    """What the poses determine."""

    positions: int
    unknowns: int = Field(description="Four of each axis and three of each target.")
    determined: int = Field(description="Independent combinations of them that the poses determine.")
    only_together: list[list[str]] = Field(
        description="The unknowns of each combination that is not determined; they keep their nominal values."
    )
    rms_residual: Metres[float] = Field(description="Of a coordinate.")


class GeometryGoodness(Message):
    """How well one robot fits all readings."""

    sigma: Metres[float] = Field(
        description="Standard uncertainty of a coordinate, by which all others are stated; of an instrument "
        "the root mean square over the readings."
    )
    sigma_source: Literal["stated", "residuals"]
    degrees_of_freedom: int
    variance_factor: float = Field(
        description="χ²/dof: 1 on average if the stated sigma is right; 1 if it comes from the residuals. "
        "Dimensionless."
    )
    agreement_probability: float | None = Field(
        description="That noise alone makes one robot fit all sweeps so badly. Small: fit them one by one."
    )
    controller_probability: float | None = Field(
        description="That noise alone makes the controller's angles fit so badly. Not small: `angles` of "
        "`controller` is the better estimate."
    )


class BaseFrameResult(Message):
    """R0 as the tracker sees it."""

    by: Literal["nominal", "axes"]
    transform_tracker_to_base: Rigid
    covariance: MixedSquares[Square6 | None] = Field(
        description="Of a small motion (δ, φ) in R0, ``y = (1 + [φ]×)(R x + t) + δ``: translation, then "
        "rotation; null if the readings do not determine it."
    )


class WristCentre(Message):
    """The wrist centre by one way."""

    tracker: Metres[Point]
    tracker_covariance: SquareMetres[Square3]
    base: Metres[Point] = Field(description="In R0.")
    base_covariance: SquareMetres[Square3] = Field(description="The uncertainty of R0 included.")


class WristEstimate(WristCentre):
    """One of the ways."""

    way: Literal["sphere", "axes", "trilateration"]
    weight: float = Field(
        description="Its share in the combined centre, over three directions. Dimensionless."
    )


class WristDistance(Message):
    """Two ways beside each other."""

    first: Literal["sphere", "axes", "trilateration"]
    second: Literal["sphere", "axes", "trilateration"]
    distance: Metres[float]
    probability: float = Field(description="That noise alone does this.")


class WristResult(Message):
    """Where the last three axes meet, and whether they do."""

    estimates: list[WristEstimate]
    combined: WristCentre = Field(description="Mean of the ways, each weighted by its information.")
    distances: list[WristDistance]
    posture: Radians[list[float]] = Field(
        description="Model angles in which the centre is where it is stated; those of the wrist do not "
        "matter."
    )
    miss_distance: Metres[float] = Field(
        description="Greatest distance of one of the three axes from the point nearest to them."
    )
    miss_uncertainty: Metres[float]
    miss_probability: float = Field(description="That axes which do meet are found so far apart.")
    decoupled_method: bool = Field(
        description="Whether the decoupled method applies: the axes miss by no more than 0.5 mm."
    )


class FlangeTarget(Message):
    """A target in the flange frame."""

    name: Name
    position: Metres[Point]
    covariance: SquareMetres[Square3 | None] = Field(description="Null if the readings do not determine it.")


class LinkComparison(Message):
    """A length or an angle of the robot, nominal beside identified."""

    quantity: Literal["a", "alpha", "beta", "d", "theta"] = Field(
        description="As Denavit and Hartenberg name them; beta is the other angle of axes meant to be "
        "parallel."
    )
    joint: Name = Field(description="Of the axis, or of the first of two neighbours.")
    unit: Literal["m", "rad"] = Field(description="Of the numbers.")
    nominal: StatedUnit[float]
    identified: StatedUnit[float]
    difference: StatedUnit[float] = Field(description="Identified less nominal.")
    standard_uncertainty: StatedUnit[float | None] = Field(
        description="Of the identified one; null if the readings do not determine it."
    )


class NearlyParallel(Message):
    """Neighbouring axes that are nearly parallel."""

    joint: Name = Field(description="Of the first.")
    angle: Radians[float]
    made_parallel: bool = Field(description="Whether the table takes them as parallel.")


class IdentifiedDh(Message):
    """The identified model as a table: ``flange to R0 = base · T1 … Tn · tool``."""

    convention: Literal["standard", "modified"]
    rows: list[DhRow]
    base: Rigid = Field(description="From frame 0 to R0.")
    tool: Rigid = Field(description="From the flange frame to frame n.")
    parallel: list[NearlyParallel]
    deviation: Metres[float] = Field(
        description="Greatest distance of the table's flange from the identified model's, over 200 random "
        "postures: what making axes parallel leaves out."
    )


class Drift(Message):
    """Motion of tracker and robot against each other between two readings of the base targets."""

    transform_after_to_before: Rigid = Field(description="Removes the drift from later readings.")
    displacement: Metres[Point] = Field(
        description="Of the middle of the targets on the flange, tracker's frame."
    )
    displacement_covariance: SquareMetres[Square3]
    rotation: Radians[Point] = Field(description="Rotation vector, tracker's frame.")
    probability: float = Field(description="That noise alone does this.")
    deformation_probability: float = Field(description="That noise alone leaves these residuals.")
    significant: bool
    moved_targets: list[Name] = Field(description="Base targets that moved against the others.")


class GeometryFinding(Message):
    """A suspicion: said with its figure, never mended silently."""

    code: Literal[
        "short_arc",
        "tracker_bumped",
        "position_suspect",
        "reading_suspect",
        "residuals_exceed_sigma",
        "residuals_below_sigma",
        "angle_scale_suspect",
        "axes_nearly_parallel",
        "base_drifted",
        "base_target_moved",
        "sweeps_disagree",
        "wrist_centres_disagree",
        "parameters_not_identified",
    ]
    severity: Literal["error", "warning", "note"]
    where: str
    figure: StatedUnit[float] = Field(description="The number that raised it, in `unit`.")
    unit: str = Field(description="Of the figure; empty where it has none.")
    message: str
    remedy: str


class GeometryResult(Message):
    """The robot as it was found."""

    axes: list[IdentifiedAxis]
    sweeps: list[SweepEvidence] = Field(description="Empty for poses.")
    poses: PoseEvidence | None = Field(description="Null for sweeps.")
    goodness: GeometryGoodness
    base_frame: BaseFrameResult
    wrist: WristResult | None = Field(description="Null where there is none: see `no_wrist`.")
    no_wrist: str | None = Field(description="Why there is no wrist centre.")
    targets: list[FlangeTarget]
    flange: Literal["nominal", "axes", "targets"] = Field(description="What places the flange frame.")
    links: list[LinkComparison] = Field(description="Empty without a nominal model.")
    robot: RobotDocument = Field(description="The identified model as a robot, ready to be posted.")
    dh: list[IdentifiedDh]
    drift: Drift | None = Field(description="Null unless base targets were read before and after.")
    findings: list[GeometryFinding]
