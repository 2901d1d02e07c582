# Verbs with the types of their options, for type checkers. tests/support/typed_verbs.py writes it.

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from os import PathLike
from typing import Any, Literal, TypedDict, Unpack

import numpy.typing as npt

from jointstiff.schemas import run as messages
from jointstiff.schemas.comparison import CampaignComparison, ComparedMethod, Comparison
from jointstiff.schemas.deflection import LinkMass, Map, MapOptions
from jointstiff.schemas.fields import Message
from jointstiff.schemas.finding import NamedCause
from jointstiff.schemas.fleet import Fleet, FleetOptions
from jointstiff.schemas.geometry import (
    Geometry,
    GeometryNoise,
    GeometryRequest,
    GeometryUnits,
    JointSweep,
    TrackedPosition,
)
from jointstiff.schemas.imports import ImportAnswer, ImportUnits
from jointstiff.schemas.measurement import Instrument, Noise, Units
from jointstiff.schemas.options import CrossValidation, OwnWeight, Resampling, RunOptions, StiffnessPrior
from jointstiff.schemas.plan import (
    AnyDirection,
    Cable,
    DeadWeight,
    DecisionGoal,
    DeflectionGoal,
    JointsGoal,
    Plan,
    PlanOptions,
    Surroundings,
)
from jointstiff.schemas.program import ProcessLoad, Program, ProgramFrame, ProgramOptions
from jointstiff.schemas.robot import JointMap, RobotDocument
from jointstiff.schemas.run import CampaignRun
from jointstiff.service.library.campaigns import Numbers
from jointstiff.service.library.cases import AnyPostures
from jointstiff.service.library.results import Prediction, TabledRun
from jointstiff.service.library.verbs import Cancel, OnProgress

File = str | PathLike[str]
Source = File | Mapping[str, Any] | messages.Campaign | messages.Run
Vector = Sequence[float] | npt.NDArray[Any]
Matrix = Sequence[Sequence[float]] | npt.NDArray[Any]
Cube = Sequence[Sequence[Sequence[float]]] | npt.NDArray[Any]

class IdentifyFields(TypedDict, total=False):
    method: Literal["complete_pose", "partial_pose", "decoupled_partial_pose"]
    weighting: Literal["covariance", "characteristic_length", "uniform"]
    characteristic_length: float | None
    positive: bool
    stiffness_bounds: Mapping[str, Sequence[float | None]]
    loss: Literal["squared", "huber", "absolute", "automatic"]
    huber_threshold: float | None
    complementary_stiffness: Literal["neglected", "included"]
    causes: Sequence[NamedCause | Mapping[str, Any]]
    priors: Mapping[str, StiffnessPrior | Mapping[str, Any]]
    stiffness_order: Sequence[Sequence[str]]
    elasticity: Literal[
        "joints",
        "joints_and_base",
        "coupled_joints",
        "diagonal_links",
        "joints_and_links",
        "links_and_base",
        "automatic",
    ]
    links: Sequence[str]
    link_penalty: float | None
    cross_validation: CrossValidation | Mapping[str, Any]
    resampling: Resampling | Mapping[str, Any] | None
    confidence: float
    weight: OwnWeight | Mapping[str, Any] | None
    leave_out: Sequence[str]

class CompareFields(TypedDict, total=False):
    ordered: bool
    confidence: float | None
    methods: Sequence[ComparedMethod | Mapping[str, Any]]
    constraints: Sequence[Literal["unconstrained", "positive"]]
    resampling: Resampling | Mapping[str, Any] | None
    run: RunOptions | Mapping[str, Any] | None

class GeometryFields(TypedDict, total=False):
    name: str
    units: str | GeometryUnits | Mapping[str, Any]
    robot_id: str | None
    robot: File | RobotDocument | Mapping[str, Any]
    joint_map: JointMap | Mapping[str, Any] | None
    noise: GeometryNoise | Mapping[str, Any] | None
    sweeps: Sequence[JointSweep | Mapping[str, Any]] | None
    poses: Sequence[TrackedPosition | Mapping[str, Any]] | None
    fit: Literal["one_by_one", "together"]
    angles: Literal["free", "controller"]
    base: Literal["nominal", "axes"] | None
    base_height: float
    flange: Literal["nominal", "axes", "targets"] | None
    flange_targets: Sequence[str] | None
    base_targets_before: Mapping[str, Vector] | None
    base_targets_after: Mapping[str, Vector] | None

class PlanFields(TypedDict, total=False):
    work_area: Matrix | None
    load: DeadWeight | Mapping[str, Any] | AnyDirection | Cable | OwnWeight | None
    targets: Mapping[str, Vector]
    directions: Matrix
    load_point: Vector | None
    sigma: float | None
    tracker: Instrument | Mapping[str, Any] | None
    torque_limits: Mapping[str, float]
    stiffness: Mapping[str, float]
    priors: Mapping[str, StiffnessPrior | Mapping[str, Any]]
    joints: Sequence[str]
    candidates: int
    postures: Matrix
    surroundings: Surroundings | Mapping[str, Any]
    distinct_angle: float
    elastic_links: bool | None
    seed: int
    accept_verdict: Literal["do_not_use"] | None
    readings: int
    goal: str | JointsGoal | Mapping[str, Any] | DeflectionGoal | DecisionGoal | None
    criterion: Literal["relative_a", "work_area", "d", "e", "worst_place"] | None
    causes: Sequence[NamedCause | Mapping[str, Any]]
    leave_out: Sequence[str]
    validation: float

class MapFields(TypedDict, total=False):
    absolute: bool
    accept_verdict: Literal["do_not_use"] | None
    name: str | None
    area: Matrix
    grid: Sequence[int]
    place: Vector
    load_point: Vector | None
    tool_axis: Vector
    directions: Matrix
    turns: int
    force: Vector
    moment: Vector | None
    axes: Literal["base", "flange"]
    direction: Vector | None
    limits: Mapping[str, Vector]
    near: Vector | None
    confidence: float

class FleetFields(TypedDict, total=False):
    name: str | None
    run: CampaignRun | Mapping[str, Any]

class CompensateFields(TypedDict, total=False):
    absolute: bool
    masses: Sequence[LinkMass | Mapping[str, Any]]
    confidence: float
    accept_verdict: Literal["do_not_use"] | None
    units: str | Units | Mapping[str, Any]
    accuracy_option: Literal["off", "same_as_measured", "compensates_load"]
    load: ProcessLoad | Mapping[str, Any] | None
    segments: Sequence[ProcessLoad | Mapping[str, Any]]
    loads: File | None
    axes: Literal["robot", "tool", "base"]
    load_point: Vector | None
    tools: Sequence[ProgramFrame | Mapping[str, Any]]
    bases: Sequence[ProgramFrame | Mapping[str, Any]]
    world: Vector | None
    flange: Vector | None
    tool_x: Vector | None
    start: Vector | None
    max_displacement: float | None
    max_rotation: float | None
    ramp_length: float
    leave_alone: Sequence[str]
    leave_others: bool
    external_axes: Literal["carry_nothing"] | None
    format: Literal["csv", "krl", "fanuc", "rapid", "ur"] | None
    mark: bool
    force: Vector

class PredictFields(TypedDict, total=False):
    absolute: bool
    masses: Sequence[LinkMass | Mapping[str, Any]]
    confidence: float
    units: str | Units | Mapping[str, Any]
    load_point: Vector | None
    place: Vector | None
    at: Vector
    moments: Numbers

class ImportFields(TypedDict, total=False):
    units: str | ImportUnits | Mapping[str, Any] | None
    columns: Mapping[str, str]
    layouts: Sequence[Sequence[str]]
    delimiter: Literal["comma", "semicolon", "tab", "whitespace"] | None
    decimal_mark: Literal["point", "comma"] | None
    header: Sequence[str] | None
    ignore: Sequence[str]
    sheet: str | None
    point_name: str | None
    file_name: str | None
    state_words: Mapping[str, Literal["unloaded", "loaded", "deflection"]]
    state: Literal["unloaded", "loaded", "deflection"] | None
    by_order: bool
    allow_missing: bool
    name: str | None
    encoders: Literal["motor", "secondary"] | None
    noise: Noise | Mapping[str, Any] | None
    flange_targets: Mapping[str, Vector]
    load_point: Vector | None
    length_unit: Literal["m", "mm"] | None
    accept_unusual: bool
    force: Vector | None
    robot_id: str | None
    show_faults: bool

class Verbs:
    def identify(
        self,
        campaign: Source,
        /,
        options: RunOptions | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
        **fields: Unpack[IdentifyFields],
    ) -> TabledRun: ...
    def compare(
        self,
        first: Source,
        second: Source | None = None,
        /,
        options: CampaignComparison | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
        **fields: Unpack[CompareFields],
    ) -> Comparison: ...
    def geometry(
        self,
        readings: File | Mapping[str, Any] | Message | None = None,
        /,
        options: GeometryRequest | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
        **fields: Unpack[GeometryFields],
    ) -> Geometry: ...
    def plan(
        self,
        source: Source | RobotDocument,
        /,
        options: PlanOptions | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
        **fields: Unpack[PlanFields],
    ) -> Plan: ...
    def map(
        self,
        run: Source,
        /,
        options: MapOptions | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
        **fields: Unpack[MapFields],
    ) -> Map: ...
    def fleet(
        self,
        *campaigns: Source,
        options: FleetOptions | None = None,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
        **fields: Unpack[FleetFields],
    ) -> Fleet: ...
    def compensate(
        self,
        run: Source,
        /,
        *files: File,
        options: ProgramOptions | None = None,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        executor: Executor | None = None,
        **fields: Unpack[CompensateFields],
    ) -> Program: ...
    def predict(
        self,
        run: Source,
        postures: AnyPostures,
        /,
        forces: Numbers | None = None,
        **options: Unpack[PredictFields],
    ) -> Prediction: ...
    def import_files(
        self,
        *files: File,
        robot: File | RobotDocument | Mapping[str, Any] | None = None,
        **options: Unpack[ImportFields],
    ) -> ImportAnswer: ...

class AsyncVerbs:
    async def identify(
        self,
        campaign: Source,
        /,
        options: RunOptions | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        **fields: Unpack[IdentifyFields],
    ) -> TabledRun: ...
    async def compare(
        self,
        first: Source,
        second: Source | None = None,
        /,
        options: CampaignComparison | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        **fields: Unpack[CompareFields],
    ) -> Comparison: ...
    async def geometry(
        self,
        readings: File | Mapping[str, Any] | Message | None = None,
        /,
        options: GeometryRequest | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        **fields: Unpack[GeometryFields],
    ) -> Geometry: ...
    async def plan(
        self,
        source: Source | RobotDocument,
        /,
        options: PlanOptions | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        **fields: Unpack[PlanFields],
    ) -> Plan: ...
    async def map(
        self,
        run: Source,
        /,
        options: MapOptions | None = None,
        *,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        **fields: Unpack[MapFields],
    ) -> Map: ...
    async def fleet(
        self,
        *campaigns: Source,
        options: FleetOptions | None = None,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        **fields: Unpack[FleetFields],
    ) -> Fleet: ...
    async def compensate(
        self,
        run: Source,
        /,
        *files: File,
        options: ProgramOptions | None = None,
        on_progress: OnProgress | None = None,
        cancel: Cancel | None = None,
        **fields: Unpack[CompensateFields],
    ) -> Program: ...
    async def predict(
        self,
        run: Source,
        postures: AnyPostures,
        /,
        forces: Numbers | None = None,
        **options: Unpack[PredictFields],
    ) -> Prediction: ...
    async def import_files(
        self,
        *files: File,
        robot: File | RobotDocument | Mapping[str, Any] | None = None,
        **options: Unpack[ImportFields],
    ) -> ImportAnswer: ...
