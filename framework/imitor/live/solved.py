"""A solved configuration on its way to another thread, and what that thread shows its sinks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imitor.kinds import Record
from imitor.tasks import TaskStack
from imitor.types import Array, BoolArray, Configuration, HumanFrame, IntArray


@dataclass(frozen=True, slots=True)
class Solved:
    """Copies of what one step gave, so that the next one can be computed meanwhile.

    Attributes:
        index: Number of the step.
        time_s: Its time [s].
        human: The person who was followed.
        q: Configuration, shape (nq,).
        contact: Feet that the robot stands on, shape (2,).
        status: Index into `STATUS`.
        anchor, anchor_pose, target, switch, stack_contact, held, object_shift: Of the tasks, as in `TaskStack`.
        compute_s: Time spent on it [s].
        arrived_s: When its datagram arrived by the performance counter [s]; NaN when nothing new had.
        ready_s: When it was solved [s].
    """

    index: int
    time_s: float
    human: HumanFrame
    q: Array
    contact: BoolArray
    status: int
    anchor: str
    anchor_pose: Array
    target: Array
    switch: BoolArray
    stack_contact: BoolArray
    held: IntArray
    object_shift: Array
    compute_s: float
    arrived_s: float
    ready_s: float

    @classmethod
    def of(cls, record: Record, arrived_s: float, ready_s: float) -> Solved:
        """Copy a record."""
        state, stack = record.state, record.stack
        return cls(
            record.index, record.time_s, record.human, state.q.copy(), state.contact.copy(), state.status,
            stack.anchor, stack.anchor_pose.copy(), stack.flat_target.copy(), stack.flat_switch.copy(),
            stack.contact.copy(), stack.held.copy(), stack.object_shift.copy(), record.compute_s, arrived_s, ready_s,
        )  # fmt: skip


class Mirror:
    """Record, tasks and state of another thread.

    Args:
        stack: Tasks of that thread's own; see `TaskStack.twin`.
        first: What it shows at first.

    Attributes:
        record: What its sinks are given.
        state: The configuration; the thread may change it.
    """

    def __init__(self, stack: TaskStack, first: Solved) -> None:
        self.stack = stack
        self.state = Configuration(first.q.copy(), first.contact.copy())
        self.record = Record(first.index, first.time_s, first.human, stack, self.state)
        self.take(first)

    def take(self, solved: Solved) -> None:
        """Show another step; ``state.q`` is left to the thread."""
        stack, record = self.stack, self.record
        np.copyto(stack.flat_target, solved.target)
        np.copyto(stack.flat_switch, solved.switch)
        np.copyto(stack.anchor_pose, solved.anchor_pose)
        np.copyto(stack.contact, solved.stack_contact)
        np.copyto(stack.held, solved.held)
        np.copyto(stack.object_shift, solved.object_shift)
        stack.anchor = solved.anchor
        np.copyto(self.state.contact, solved.contact)
        self.state.status = solved.status
        record.index, record.time_s, record.human = solved.index, solved.time_s, solved.human
        record.compute_s, record.latency_s = solved.compute_s, solved.ready_s - solved.arrived_s


__all__ = ["Mirror", "Solved"]
