"""Who may move the arm: one client at a time, for as long as it is heard of."""

import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from dovetail.errors import ArmError

TIMEOUT_MIN, TIMEOUT_MAX, TIMEOUT = 0.2, 600.0, 10.0
"""Range and default of the time after which a silent holder loses the lease [s]."""


@dataclass(eq=False)
class Holder:
    """A client that may move the arm."""

    name: str
    """What it calls itself."""
    peer: str
    """Where it calls from."""
    timeout: float
    """It loses the lease after so long without a call [s]."""
    lease: str = field(default_factory=lambda: secrets.token_hex(16))
    """The secret that it shows with every call."""
    since: float = 0.0
    """When it got the lease, by the clock [s]."""
    heard: float = 0.0
    """When it was last heard of, by the clock [s]."""
    busy: int = 0
    """Calls of it that are being served: it cannot time out meanwhile."""
    end_stream: Callable[[], object] | None = None
    """Ends the control stream that is tied to the lease; None if there is none."""

    def __str__(self) -> str:
        """Name and address, for messages."""
        return f"{self.name} at {self.peer}"


class LeaseBook:
    """At most one holder; whoever ends, by whatever cause, ends through `end`."""

    def __init__(
        self,
        on_end: Callable[[Holder, str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start without a holder.

        Args:
            on_end: Called with the holder and the reason when a lease has ended,
                before anyone else can get it.
            clock: Time [s], monotonic.
        """
        self._on_end = on_end
        self._clock = clock
        self._changed = threading.Condition()
        self._holder: Holder | None = None
        self._ending = False
        self._closed = False
        self._last = "there was no lease yet"
        self._watch = threading.Thread(
            target=self._expire, name="dovetail-lease", daemon=True
        )
        self._watch.start()

    @property
    def holder(self) -> Holder | None:
        """Who may move the arm."""
        return self._holder

    def acquire(self, name: str, peer: str, timeout: float) -> Holder:
        """Give the lease to a client.

        Raises:
            ArmError: Someone else has it; names who and since when.
        """
        with self._changed:
            self._changed.wait_for(lambda: not self._ending, timeout=5.0)
            now = self._clock()
            if (held := self._holder) is not None or self._ending:
                since = f" for {now - held.since:.0f} s" if held is not None else ""
                raise ArmError(
                    f"the arm is held by {held or 'a client that just left'}{since}: "
                    "one client at a time may move it; wait until that one has "
                    "finished, or end it"
                )
            self._holder = Holder(name, peer, timeout, since=now, heard=now)
            self._changed.notify_all()
            return self._holder

    def require(self, lease: str) -> Holder:
        """Return the holder that shows this lease, and note that it was heard of.

        Raises:
            ArmError: It has none, or no longer; says why.
        """
        held = self._holder
        if held is None or not secrets.compare_digest(
            held.lease.encode(), lease.encode()
        ):
            now = f"; now {held} holds the arm" if held is not None else ""
            raise ArmError(
                "this client does not hold the arm's lease: "
                + (f"{self._last}{now}" if lease else "acquire it first")
            )
        held.heard = self._clock()
        return held

    def use(self, lease: str) -> "_Use":
        """Serve a call of the holder, which cannot time out meanwhile.

        Raises:
            ArmError: As `require`, when the context is entered.
        """
        return _Use(self, lease)

    def bind(self, lease: str, end_stream: Callable[[], object]) -> Holder:
        """Tie the lease to a control stream: neither outlives the other.

        Args:
            lease: The holder's.
            end_stream: Ends the stream, from any thread; called when the lease ends.

        Raises:
            ArmError: Not the holder, or a stream is tied to it already.
        """
        with self._changed:
            held = self.require(lease)
            if held.end_stream is not None:
                raise ArmError(
                    f"a control stream of {held} is open already: use that one"
                )
            held.end_stream = end_stream
        return held

    def end(self, holder: Holder, reason: str) -> None:
        """End a lease and its stream; nothing happens if it has ended already."""
        with self._changed:
            if self._holder is not holder:
                return
            self._holder, self._ending = None, True
            self._last = f"the lease of {holder} has ended ({reason})"
        try:
            self._on_end(holder, reason)
        finally:
            if holder.end_stream is not None:
                holder.end_stream()
            with self._changed:
                self._ending = False
                self._changed.notify_all()

    def close(self) -> None:
        """End the lease, if there is one, and the watch over it."""
        if self._holder is not None:
            self.end(self._holder, "the service has closed")
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._watch.join(timeout=5.0)

    def _expire(self) -> None:
        while True:
            with self._changed:
                held = self._holder
                left = None
                if held is not None:
                    left = held.heard + held.timeout - self._clock()
                    left = held.timeout if held.busy else left
                if not self._closed and (left is None or left > 0.0):
                    self._changed.wait(left)
                if self._closed:
                    return
                if held is None or held.busy or left is None or left > 0.0:
                    continue
            self.end(held, f"nothing was heard of it for {held.timeout:g} s")


class _Use:
    """A holder's call under way; no generator, because each step is one."""

    def __init__(self, book: LeaseBook, lease: str) -> None:
        self._book, self._lease = book, lease

    def __enter__(self) -> Holder:
        self._held = self._book.require(self._lease)
        with self._book._changed:
            self._held.busy += 1
        return self._held

    def __exit__(self, *error: object) -> None:
        with self._book._changed:
            self._held.busy -= 1
            self._held.heard = self._book._clock()
