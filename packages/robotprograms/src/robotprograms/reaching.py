"""Relations: nodes that are reached along their edges."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Node = TypeVar("Node", bound=object)


def reach(
    starts: Iterable[Node], edges: Callable[[Node], Iterable[Node]], known: set[Node]
) -> Iterator[tuple[Node, Node]]:
    """Yield each node that edges lead to, with the node before it, once.

    Args:
        starts: nodes from which the edges are followed.
        edges: function that returns the nodes to which the edges of a node lead.
        known: nodes that are not yielded and not passed through; each yielded node is added.
    """
    to_visit = list(starts)
    while to_visit:
        node = to_visit.pop()
        for other in edges(node):
            if other not in known:
                known.add(other)
                to_visit.append(other)
                yield node, other
