"""How far around a tile its nodes are worked out, so that no result depends on where tiles begin."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from .film import Take
from .graph import WHOLE, Graph, Node, Rate
from .sampling import Sampling


def reach_of(node: Node) -> int:
    """How many pixels, rows and columns, the node's step reads of its inputs beyond its own pixel."""
    reach = node.step.reach
    if reach == WHOLE:
        return 0
    return reach if isinstance(reach, int) else reach(node)


def reads_whole(nodes: Iterable[Node]) -> bool:
    """Whether any of them needs all of a sample's image at once."""
    return any(node.step.reach == WHOLE and node.rate == Rate.SAMPLE for node in nodes)


def fitted(sampling: Sampling, nodes: Iterable[Node]) -> Sampling:
    """The same; a whole sample at a time where any of the nodes needs that."""
    if not reads_whole(nodes):
        return sampling
    return replace(sampling, tile_pixels=sampling.width * sampling.height)


def margins_of(graph: Graph, takes: Iterable[Take]) -> dict[Node, tuple[int, ...]]:
    """Of each node made sample by sample, how many pixels around a tile are wanted of it: the most first, and
    what each of its readers wants. Films want no more than the tile; a reader wants as much as is wanted of
    itself and its reach. Raises ValueError where a step reads neighbours beyond an image that ends at its
    border: a finished one, or what a step made of all of a sample's."""
    wanted: dict[Node, set[int]] = {}
    for take in takes:
        wanted.setdefault(take.node, set()).add(0)
        if take.weight is not None:
            wanted.setdefault(take.weight, set()).add(0)
    for node in reversed(graph.nodes()):
        reach = reach_of(node)
        if (node.rate == Rate.PICTURE and reach) or (node.step.reach == WHOLE and any(wanted.get(node, ()))):
            raise ValueError(f"step '{node.step.name}' is of whole images: there is nothing around them")
        for item in node.inputs:
            if item.rate == node.rate == Rate.SAMPLE:
                wanted.setdefault(item, set()).update(margin + reach for margin in wanted[node])
    return {node: tuple(sorted(margins, reverse=True)) for node, margins in wanted.items()}
