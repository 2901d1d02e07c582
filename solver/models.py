"""Models of what bends, from simple to rich, and the columns of their compliances (method.md §7, §14)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np

from jointstiff.schemas.options import ElasticModel as ModelName
from jointstiff.schemas.options import RunOptions
from jointstiff.solver.arrays import IndexArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.mechanics import springs
from jointstiff.solver.mechanics.block import Term
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import build_links_term

MOST_JOINTS: Final = 12
"""Greatest number of joints of a robot with elastic links: with more joints, unknowns outnumber readings."""


@dataclass(frozen=True)
class ElasticModel:
    """Elastic elements that bend under known loads; all others are rigid. Joints bend in every model."""

    name: ModelName
    couples_joints: bool = False  #: whether a full positive semidefinite compliance couples the joints
    #: compliance of each link: none, six numbers, or a full positive semidefinite 6 × 6 matrix
    links: Literal["rigid", "diagonal", "full"] = "rigid"
    has_base: bool = False  #: whether the base has a full 6 × 6 compliance

    @property
    def has_only_joints(self) -> bool:
        """True if nothing but the joints bends, each by itself."""
        return not (self.couples_joints or self.has_links or self.has_base)

    @property
    def has_links(self) -> bool:
        """True if links bend."""
        return self.links != "rigid"

    def list_frames(self, columns: Columns) -> tuple[int, ...]:
        """Return the frames of the links and base that bend: joint indices of the links, then `BASE`."""
        frames = list[int]()
        if self.has_links:
            frames.extend(columns.links)
        if self.has_base:
            frames.append(springs.BASE)
        return tuple(frames)


JOINTS: Final = ElasticModel("joints")
JOINTS_AND_BASE: Final = ElasticModel("joints_and_base", has_base=True)
COUPLED_JOINTS: Final = ElasticModel("coupled_joints", couples_joints=True)
DIAGONAL_LINKS: Final = ElasticModel("diagonal_links", links="diagonal")
JOINTS_AND_LINKS: Final = ElasticModel("joints_and_links", links="full")
LINKS_AND_BASE: Final = ElasticModel("links_and_base", links="full", has_base=True)

ELASTIC_MODELS: Final = (
    JOINTS,
    JOINTS_AND_BASE,
    COUPLED_JOINTS,
    DIAGONAL_LINKS,
    JOINTS_AND_LINKS,
    LINKS_AND_BASE,
)
"""The models of known loads, from simple to rich, which compete on the same readings."""


@dataclass(frozen=True)
class WeightModel:
    """Joints that bend under the robot's own weight, fitted together with masses and geometry."""

    name: Literal["own_weight"] = "own_weight"


OWN_WEIGHT: Final = WeightModel()

Model: TypeAlias = ElasticModel | WeightModel
MODELS: Final[tuple[Model, ...]] = (*ELASTIC_MODELS, OWN_WEIGHT)
"""All models."""


_ENTRIES_OF_LINK: Final = 21
"""Number of entries in the upper triangle of a 6 × 6 compliance matrix."""


def find_model(name: ModelName) -> ElasticModel:
    """Return the model of known loads with this name."""
    return next(model for model in ELASTIC_MODELS if model.name == name)


@dataclass(frozen=True)
class Columns:
    """Columns of each compliance among the P columns of the richest model.

    A symmetric compliance matrix has one column for each entry of its upper triangle.

    Raises:
        UnsupportedMethodError: the robot has too many joints.
    """

    n: int  #: number of joints
    links: tuple[int, ...]  #: indices of the joints whose links may bend; the base may bend in any case

    def __post_init__(self) -> None:
        """Refuse a robot with too many joints."""
        if self.n > MOST_JOINTS:
            raise UnsupportedMethodError(
                f"the robot has {self.n} joints; elastic links support at most {MOST_JOINTS}",
                where="elasticity",
                remedy="use elasticity joints",
            )

    @classmethod
    def from_options(cls, options: RunOptions, robot: Robot) -> Columns:
        """Return the columns for the links that the options name; for all links if they name none.

        Raises:
            RequestError: the robot has no joint that an option names.
            UnsupportedMethodError: the robot has too many joints.
        """
        named_links = sorted({robot.joint_index(name, "links") for name in options.links})
        all_links = range(robot.n)
        return cls(robot.n, tuple(named_links or all_links))

    @property
    def width(self) -> int:
        """Number P of columns: of the joints, of their coupling, and 21 for each link and for the base."""
        return self.n + len(self.coupling) + _ENTRIES_OF_LINK * len(self.frames)

    @property
    def frames(self) -> tuple[int, ...]:
        """Frames with a 6 × 6 compliance (21 different entries): joint indices of the links, then `BASE`."""
        return *self.links, springs.BASE

    @property
    def joints(self) -> IndexArray:
        """(n,) columns of the joint compliances c [m/(rad/(N·m))]."""
        return np.arange(self.n)

    @property
    def coupling(self) -> IndexArray:
        """Columns (n (n + 1) / 2,) of the full compliance matrix C_θ of the joints [m/(rad/(N·m))]."""
        entry_count = self.n * (self.n + 1) // 2  # of the upper triangle
        return np.arange(self.n, self.n + entry_count)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the deflection model in the order of the columns: joints, coupling, links and base."""
        return springs.JOINTS, springs.COUPLED_JOINTS, build_links_term(self.frames)

    def link_columns(self, frame: int) -> IndexArray:
        """Return the columns (21,) of the 6 × 6 compliance of the link behind joint `frame`, or of `BASE`."""
        columns_of_joints = self.n + len(self.coupling)
        first = columns_of_joints + _ENTRIES_OF_LINK * self.frames.index(frame)
        return np.arange(first, first + _ENTRIES_OF_LINK)
