"""One way of the network, with its faults, in any clock's time."""

import heapq
import random
from typing import NamedTuple

from dovetail.cabinet.faults import FaultConfig, LinkFaults


class Parcel(NamedTuple):
    """A datagram under way."""

    due: float
    """Time of arrival [s]."""
    serial: int
    """Order of sending among those that arrive together."""
    payload: bytes
    tag: int
    """Number that the sender gives it; copies carry -1."""
    is_intact: bool
    """It is the first copy, unchanged."""


class Link:
    """Datagrams on their way: some are lost, doubled, late, changed or cut."""

    def __init__(self, period: float) -> None:
        """Begin without faults.

        Args:
            period: Time between two datagrams [s]; what reordering takes.
        """
        self._period = period
        self._queue: list[Parcel] = []
        self._serial = 0
        self._random = random.Random(0)
        self.faults = LinkFaults()
        self._is_clear = True
        self.lost = 0
        """Datagrams lost so far."""

    def configure(self, faults: FaultConfig, way: str) -> None:
        """Change the faults; what is under way stays so.

        Args:
            faults: The faults.
            way: Which way this link is, "to_client" or "from_client".
        """
        acts = faults.direction in ("both", way)
        self.faults = faults if acts else LinkFaults()
        self._is_clear = self.faults.is_clear
        self._random = random.Random(f"{way} {faults.seed}")

    @property
    def is_idle(self) -> bool:
        """True if every datagram passes at once and nothing is under way."""
        return self._is_clear and not self._queue

    def send(self, payload: bytes, now: float, tag: int = 0) -> None:
        """Put a datagram on its way at a time [s]."""
        faults, draw = self.faults, self._random.random
        if draw() < faults.loss:
            self.lost += 1
            return
        due = now + faults.delay + draw() * faults.jitter
        if draw() < faults.reorder:
            due += 1.01 * self._period
        is_intact = True
        if payload and draw() < faults.corrupt:
            payload, is_intact = self._corrupted(payload), False
        if payload and draw() < faults.truncate:
            payload, is_intact = payload[: self._random.randrange(len(payload))], False
        self._push(due, payload, tag, is_intact)
        if draw() < faults.duplicate:
            self._push(due, payload, -1, False)

    def _push(self, due: float, payload: bytes, tag: int, is_intact: bool) -> None:
        self._serial += 1
        parcel = Parcel(due, self._serial, payload, tag, is_intact)
        heapq.heappush(self._queue, parcel)

    def _corrupted(self, payload: bytes) -> bytes:
        changed = bytearray(payload)
        for _ in range(self._random.randint(1, 4)):
            changed[self._random.randrange(len(changed))] ^= self._random.randint(
                1, 255
            )
        return bytes(changed)

    @property
    def next_due(self) -> float:
        """Time of the next arrival [s]; infinity if no datagram is under way."""
        return self._queue[0].due if self._queue else float("inf")

    def take(self, until: float) -> Parcel | None:
        """Return the next datagram that arrives no later than a time [s]."""
        if self._queue and self._queue[0].due <= until:
            return heapq.heappop(self._queue)
        return None

    def clear(self) -> None:
        """Lose everything that is under way."""
        self._queue.clear()
