"""What stands for a twin in viewports over which its splats are drawn: the edges of a box around most of them.

It can be selected, framed and snapped to, and costs nothing.
"""

from __future__ import annotations

from typing import Any

from .graph import Graph

#: The box reaches so many standard deviations from the mean, and no farther than the farthest splat: a few stray ones
#: would make it many times as large as the twin.
_DEVIATIONS = 2.5

#: Whether new twins are shown so.
_drawn_live = False


def outline(graph: Graph, points: Any) -> Any:
    """The edges of a box around `points`, as geometry."""
    position = graph.node("GeometryNodeInputPosition").outputs[0]
    node = graph.node("GeometryNodeAttributeStatistic", points, data_type="FLOAT_VECTOR")
    graph.plug(next(s for s in node.inputs if s.name == "Attribute" and s.enabled), position)
    mean, least, most, deviation = (
        next(socket for socket in node.outputs if socket.name == name and socket.enabled)
        for name in ("Mean", "Min", "Max", "Standard Deviation")
    )
    away = graph.vector("SCALE", deviation, _DEVIATIONS)
    low = graph.vector("MAXIMUM", least, graph.vector("SUBTRACT", mean, away))
    high = graph.vector("MINIMUM", most, graph.vector("ADD", mean, away))
    cube = graph.node("GeometryNodeMeshCube", graph.vector("SUBTRACT", high, low)).outputs[0]
    middle = graph.vector("SCALE", graph.vector("ADD", low, high), 0.5)
    moved = graph.node("GeometryNodeSetPosition", cube, None, None, middle).outputs[0]
    return graph.node("GeometryNodeDeleteGeometry", moved, domain="FACE", mode="ONLY_FACE").outputs[0]


def drawn_live() -> bool:
    """Whether Descatter draws splats over viewports now."""
    return _drawn_live


def set_drawn_live(on: bool) -> None:
    """Says whether it does."""
    global _drawn_live
    _drawn_live = on
