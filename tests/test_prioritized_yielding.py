"""A level that cannot be reached leaves what it hardly controls to lower ones, and higher ones stay exact."""

from __future__ import annotations

from typing import Any

import numpy as np

from imitor import Configuration, TaskKind, TaskStack, testing
from imitor.registry import Registry

ORDER = [["right_foot"], ["com"], ["head"], ["left_wrist", "right_wrist"]]


def errors(yielding: float | list[float]) -> dict[str, float]:
    """Return the errors after 2 s of a head 0.14 m off, which only arms as counterweights bring nearer [m]."""
    robot = testing.make_robot("hrp2")
    cls: Any = Registry(entry_points=False).get("solver", "prioritized")
    config = cls.config_type(order=ORDER, damping=[0.001, 0.001, 0.002, 0.02], yielding=yielding)
    solver = cls(config, testing.make_context(robot))
    stack = TaskStack(robot.n)
    stack.declare("right_foot", TaskKind.POSE, frame="right_foot")
    stack.declare("com", TaskKind.COM)
    for name in ("head", "left_wrist", "right_wrist"):
        stack.declare(name, TaskKind.POSITION, frame=name)
    stack.compile()
    solver.prepare(stack)
    solver.start()
    robot.update(robot.standing)
    stack["right_foot"].target[:] = robot.pose("right_foot")
    stack["com"].target[:] = robot.com
    stack["com"].mask[:] = (True, True, False)
    for name in ("head", "left_wrist", "right_wrist"):
        stack[name].target[:] = robot.position(name)
    stack["head"].target[:] += (0.1, 0.0, 0.1)
    stack.anchor, stack.anchor_pose = "left_foot", robot.pose("left_foot")
    state = Configuration(robot.standing.copy(), np.ones(2, dtype=bool))
    for _ in range(200):
        solver.step(stack, state)
        state.sent = state.q.copy()
    out = {
        name: float(np.linalg.norm(robot.position(name) - stack[name].target))
        for name in ("head", "left_wrist", "right_wrist")
    }
    foot = robot.position("right_foot") - stack["right_foot"].target[:3, 3]
    out["foot"], out["com"] = (
        float(np.linalg.norm(foot)),
        float(np.linalg.norm((robot.com - stack["com"].target)[:2])),
    )
    return out


def test_arms_are_no_counterweights_of_a_head_out_of_reach() -> None:
    strict, yields = errors(0.0), errors([0.0, 0.0, 0.3, 0.0])
    for side in ("left", "right"):
        assert strict[f"{side}_wrist"] > 0.06
        assert yields[f"{side}_wrist"] < 0.035
    assert yields["head"] < strict["head"] + 0.01
    assert max(yields["foot"], yields["com"]) < 1e-3
