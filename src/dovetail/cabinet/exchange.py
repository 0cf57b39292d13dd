"""Timing of messages and replies: by the clock, or in lockstep."""

import select
import time
from abc import ABC, abstractmethod
from typing import Protocol

from dovetail.cabinet.faults import FaultConfig
from dovetail.cabinet.link import Link
from dovetail.cabinet.udp_port import UdpPort

_SEARCH_TIME = 0.02
"""Wait of lockstep for a reply while it may have no client [s]."""
_LINGER_TIME = 0.2
"""The same after a client has just answered, or with its phase unknown [s]."""
_RESEND_TIME = 0.5
"""Period at which lockstep repeats a message without a reply [s]."""


class Receiver(Protocol):
    """Recipient of an exchange's datagrams and requests."""

    def take(self, payload: bytes) -> bool:
        """Take a client's datagram; return whether it is the reply waited for."""
        ...

    def reflects(self, payload: bytes) -> int | None:
        """Return which message a datagram answers; None where it cannot be read."""
        ...

    def serve(self) -> bool:
        """Serve requests; return whether they made the period void."""
        ...


class Exchange(ABC):
    """The network between cabinet and client."""

    overruns = 0
    """Periods that began too late by more than one period; none in lockstep."""

    def __init__(
        self, port: UdpPort, wake: int, receiver: Receiver, period: float
    ) -> None:
        """Begin without faults.

        Args:
            port: UDP port.
            wake: Descriptor that becomes readable when requests wait.
            receiver: Takes datagrams and serves requests.
            period: Send period [s].
        """
        self.port = port
        self.period = period
        self.to_client = Link(period)
        self.from_client = Link(period)
        self._receiver = receiver
        self._wake = wake
        self._sources = [port.fileno(), wake]

    def configure(self, faults: FaultConfig) -> None:
        """Change the faults of both ways."""
        self.to_client.configure(faults, "to_client")
        self.from_client.configure(faults, "from_client")

    @property
    @abstractmethod
    def now(self) -> float:
        """Time by this exchange's clock [s]."""

    @abstractmethod
    def transact(self, payload: bytes, sequence: int, *, is_due: bool) -> None:
        """Send a message; return when a reply counts or none can any more.

        Args:
            payload: The datagram.
            sequence: Its sequence counter.
            is_due: A reply in this period is the last that counts in its slot.
        """

    @abstractmethod
    def rest(self) -> None:
        """Pass what is left of the period."""

    @abstractmethod
    def shift(self, duration: float) -> None:
        """Stand still for a duration [s]."""

    def _is_interrupted(self, readable: list[int]) -> bool:
        return self._wake in readable and self._receiver.serve()


class WallExchange(Exchange):
    """By the clock: a message at each absolute deadline, with or without a reply."""

    _deadline = 0.0
    _is_void = False

    @property
    def now(self) -> float:
        """Time by the machine's clock [s]."""
        return time.monotonic()

    def transact(self, payload: bytes, sequence: int, *, is_due: bool) -> None:
        """Send the message; wait for a reply until the next deadline."""
        now = time.monotonic()
        if now > self._deadline + self.period:
            # Simulated time lags behind: no burst of messages that none can answer.
            self.overruns += self._deadline > 0.0
            self._deadline = now
        self._deadline += self.period
        self._is_void = False
        if self.to_client.is_idle:
            self.port.send(payload)
        else:
            self.to_client.send(payload, now, sequence)
        self._pump(stops_at_reply=True)

    def rest(self) -> None:
        """Wait for the deadline; replies that come now are counted as what they are."""
        if not self._is_void:
            self._pump(stops_at_reply=False)

    def shift(self, duration: float) -> None:
        """Stand still, requests apart."""
        until = time.monotonic() + duration
        while (left := until - time.monotonic()) > 0.0:
            readable, _, _ = select.select([self._wake], [], [], left)
            if self._is_interrupted(readable):
                return
        self._deadline = 0.0

    def _pump(self, *, stops_at_reply: bool) -> None:
        receiver, port = self._receiver, self.port
        to_client, from_client = self.to_client, self.from_client
        while True:
            now = time.monotonic()
            while parcel := to_client.take(now):
                port.send(parcel.payload)
            is_reply = False
            while parcel := from_client.take(now):
                is_reply |= receiver.take(parcel.payload)
            if is_reply and stops_at_reply:
                return
            until = min(self._deadline, to_client.next_due, from_client.next_due)
            if now >= self._deadline:
                return
            wait = max(until - now, 0.0)
            readable, _, _ = select.select(self._sources, [], [], wait)
            if self._is_interrupted(readable):
                self._is_void = True
                return
            payload = port.receive() if port.fileno() in readable else None
            if payload is None:
                continue
            if not from_client.is_idle:
                from_client.send(payload, time.monotonic())
            elif receiver.take(payload) and stops_at_reply:
                return


class LockstepExchange(Exchange):
    """In lockstep: the next message when the reply has come; time is virtual.

    Delays pass in virtual time: no real time is spent on a late or lost datagram.
    """

    def __init__(
        self,
        port: UdpPort,
        wake: int,
        receiver: Receiver,
        period: float,
        *,
        patience: float,
        multiplier: int,
    ) -> None:
        """Begin at virtual time 0.

        Args:
            port: UDP port.
            wake: Descriptor that becomes readable when requests wait.
            receiver: Takes datagrams and serves requests.
            period: Send period [s].
            patience: Longest wait for a reply [s].
            multiplier: The client answers every so many messages.
        """
        super().__init__(port, wake, receiver, period)
        self._longest_wait = patience
        self._multiplier = multiplier
        self._time = 0.0
        self._unanswered = 0  # messages that the client has seen since its last reply
        self._is_known = False  # the client has answered when it had to
        self._newest = -1
        self.is_patient = False
        """Wait as long as patience lasts: a client was there."""

    @property
    def now(self) -> float:
        """Virtual time [s]: how many periods have passed."""
        return self._time

    def transact(self, payload: bytes, sequence: int, *, is_due: bool) -> None:
        """Send the message; wait for the reply, if it reaches the client."""
        self._newest = sequence
        if self.to_client.is_idle and self.from_client.is_idle:
            self.port.send(payload)
            if self._expects_reply():
                self._await(payload, sequence, None)
            elif is_due:
                self._drain()
        else:
            self.to_client.send(payload, self._time, sequence)
            self._pass_period()

    def _expects_reply(self) -> bool:
        """Count a message that the client sees; return whether it must answer it."""
        self._unanswered += 1
        return not self._is_known or self._unanswered >= self._multiplier

    def _pass_period(self) -> None:
        """Let everything arrive that is due in this period, in its order."""
        end = self._time + self.period * (1.0 - 1e-9)
        to_client, from_client = self.to_client, self.from_client
        while min(to_client.next_due, from_client.next_due) <= end:
            if from_client.next_due <= to_client.next_due:
                parcel = from_client.take(end)
                if parcel:
                    self._receiver.take(parcel.payload)
                continue
            parcel = to_client.take(end)
            if parcel is None:
                continue
            self.port.send(parcel.payload)
            is_new = parcel.is_intact and parcel.tag == self._newest
            if not (is_new and self._expects_reply()):
                continue
            if self._await(parcel.payload, parcel.tag, parcel.due):
                return
        self._drain()

    def _await(self, message: bytes, sequence: int, sent: float | None) -> bool:
        """Wait for the reply to a message; repeat it for a client that starts late.

        Args:
            message: The datagram.
            sequence: Its sequence counter.
            sent: When it arrived, in virtual time [s], where the reply has to pass a
                faulty link; None where it counts at once.

        Returns:
            Whether a request has made the period void.
        """
        end = time.monotonic() + self._patience()
        port, receiver = self.port, self._receiver
        repeat = time.monotonic() + _RESEND_TIME
        while (left := end - time.monotonic()) > 0.0:
            wait = repeat - time.monotonic()
            if wait <= 0.0:  # by the clock: requests wake this loop at any time
                port.send(message)
                repeat += _RESEND_TIME
                continue
            readable, _, _ = select.select(self._sources, [], [], min(left, wait))
            if self._is_interrupted(readable):
                return True
            payload = port.receive() if port.fileno() in readable else None
            if payload is None:
                if port.is_refused and self.is_patient:
                    break  # the client is gone: its port is closed
                continue
            if sent is None:
                is_reply = receiver.take(payload)
            else:
                is_reply = receiver.reflects(payload) == sequence
                self.from_client.send(payload, sent)
            if is_reply:
                self._unanswered, self._is_known = 0, True
                return False
        self._is_known = False
        return False

    def _patience(self) -> float:
        """Return the longest wait for the reply [s], by the machine's clock."""
        if not self.is_patient:
            return _LINGER_TIME if self._is_known else _SEARCH_TIME
        is_regular = self._multiplier == 1 or self.to_client.is_idle
        if is_regular and (self._is_known or self._multiplier == 1):
            return self._longest_wait
        return _LINGER_TIME

    def _drain(self) -> None:
        """Take what has come without being waited for."""
        while True:
            readable, _, _ = select.select(self._sources, [], [], 0.0)
            if not readable or self._is_interrupted(readable):
                return
            payload = self.port.receive() if self.port.fileno() in readable else None
            if payload is not None:
                self._receiver.take(payload)

    def rest(self) -> None:
        """Let one period pass at once."""
        self._time += self.period

    def shift(self, duration: float) -> None:
        """Stand still, by the machine's clock too, so that the client notices."""
        select.select([self._wake], [], [], duration)
        self._time += duration
