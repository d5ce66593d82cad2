"""The place between two threads: the newest wins, nothing is taken twice, nobody waits for nothing."""

from __future__ import annotations

import threading
import time

from imitor.live.mailbox import Mailbox


def test_the_newest_wins_and_is_taken_once() -> None:
    box: Mailbox[int] = Mailbox()
    assert box.take() is None
    for k in range(3):
        box.put(k)
    assert box.replaced == 2
    assert box.take() == 2
    assert box.take(0.01) is None


def test_closing_wakes_who_waits_and_nobody_waits_afterwards() -> None:
    box: Mailbox[int] = Mailbox()
    taken: list[int | None] = []
    waiting = threading.Thread(target=lambda: taken.append(box.take(60.0)))
    waiting.start()
    box.close()
    waiting.join(10.0)
    assert not waiting.is_alive()
    assert [taken, box.take(60.0), box.take(60.0)] == [[None], None, None]
    box.put(1)
    assert box.take(60.0) == 1


def test_two_threads_lose_nothing_but_what_was_replaced() -> None:
    box: Mailbox[int] = Mailbox()
    n = 20_000
    taken: list[int] = []

    def put() -> None:
        for k in range(n):
            box.put(k)
            if k % 7 == 0:
                time.sleep(0)
        box.put(n)

    thread = threading.Thread(target=put)
    thread.start()
    nothing = 0
    while not taken or taken[-1] < n:
        thing = box.take(60.0)
        if thing is None:
            nothing += 1
        else:
            taken.append(thing)
    thread.join()
    assert nothing == 0  # never woken in vain
    assert taken == sorted(set(taken))
    assert len(taken) + box.replaced == n + 1
