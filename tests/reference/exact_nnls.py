"""Non-negative least squares in rational arithmetic: the reference that has no rounding."""

from collections.abc import Sequence

from flint import fmpq, fmpq_mat

from jointstiff.solver.arrays import FloatArray

__all__ = ["exact_nnls"]


def exact_nnls(A: FloatArray, b: FloatArray) -> list[fmpq]:
    """Minimise ‖A x − b‖ subject to x ≥ 0, without any rounding.

    Lawson and Hanson's active-set method on the normal equations ``AᵀA x = Aᵀb``, which lose nothing
    here: every float is a rational number. A column enters only while its gradient is not zero, so it
    is independent of those within, and each step lowers the objective, so no support comes twice.

    Args:
        A: (m, n) finite floats.
        b: (m,) finite floats.

    Returns:
        The n numbers, zeros being exact. Where the columns are dependent, one of the optima.
    """
    matrix = fmpq_mat(*A.shape, [_rational(value) for value in A.ravel()])
    right = fmpq_mat(len(b), 1, [_rational(value) for value in b])
    transposed = matrix.transpose()
    gram, moment = transposed * matrix, transposed * right
    n = A.shape[1]
    x, passive = [fmpq(0)] * n, list[int]()
    while (entering := _steepest(gram, moment, x, passive)) is not None:
        passive = sorted([*passive, entering])
        x, passive = _descend(gram, moment, x, passive)
    return x


def _rational(value: float) -> fmpq:
    return fmpq(*float(value).as_integer_ratio())


def _steepest(gram: fmpq_mat, moment: fmpq_mat, x: list[fmpq], passive: Sequence[int]) -> int | None:
    """The column outside whose growth lowers the objective fastest for its length; None at the optimum."""
    n = len(x)
    gains = {}
    for j in set(range(n)) - set(passive):
        descent = moment[j, 0] - sum((gram[j, k] * x[k] for k in passive), fmpq(0))
        if descent > 0:
            gains[j] = descent * descent / gram[j, j]
    return max(gains, key=gains.__getitem__) if gains else None


def _descend(
    gram: fmpq_mat, moment: fmpq_mat, x: list[fmpq], passive: list[int]
) -> tuple[list[fmpq], list[int]]:
    """Go to the least squares of the columns within, dropping each that reaches zero on the way."""
    n = len(x)
    while True:
        goal = _least_squares(gram, moment, passive, n)
        blocking = [j for j in passive if goal[j] <= 0]
        if not blocking:
            return goal, passive
        step = min(x[j] / (x[j] - goal[j]) if x[j] > goal[j] else fmpq(0) for j in blocking)
        x = [at + step * (to - at) for at, to in zip(x, goal, strict=True)]
        passive = [j for j in passive if x[j] > 0]
        x = [value if j in passive else fmpq(0) for j, value in enumerate(x)]


def _least_squares(gram: fmpq_mat, moment: fmpq_mat, passive: Sequence[int], n: int) -> list[fmpq]:
    size = len(passive)
    matrix = fmpq_mat(size, size, [gram[i, j] for i in passive for j in passive])
    right = fmpq_mat(size, 1, [moment[i, 0] for i in passive])
    solution = matrix.solve(right)
    goal = [fmpq(0)] * n
    for row, j in enumerate(passive):
        goal[j] = solution[row, 0]
    return goal
