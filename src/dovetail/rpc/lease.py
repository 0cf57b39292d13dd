"""The lease: one client at a time moves the arm, while its control stream is open."""

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from dovetail.errors import ArmError


@dataclass(eq=False)
class Holder:
    """A client that may move the arm."""

    name: str
    """As it calls itself."""
    peer: str
    """Address from which it calls."""
    lease: str = field(default_factory=lambda: secrets.token_hex(16))
    """Secret that it shows with its calls outside the stream."""
    since: float = field(default_factory=time.monotonic)
    """Time at which it got the lease [s], monotonic clock."""

    def __str__(self) -> str:
        """Name and address, for messages."""
        return f"{self.name} at {self.peer}"


class LeaseBook:
    """At most one holder. Changed by the thread of the service's calls only."""

    def __init__(self, on_end: Callable[[Holder, str], None]) -> None:
        """Start without a holder.

        Args:
            on_end: Called with the holder and the reason when a lease has ended; no
                other call is served before it returns.
        """
        self._on_end = on_end
        self._holder: Holder | None = None
        self._last = "there was no lease yet"

    @property
    def holder(self) -> Holder | None:
        """The client that may move the arm."""
        return self._holder

    def acquire(self, name: str, peer: str) -> Holder:
        """Give the lease to a client.

        Raises:
            ArmError: Another client has it; says which and since when.
        """
        if (held := self._holder) is not None:
            raise ArmError(
                f"the arm is held by {held} for {time.monotonic() - held.since:.0f} s: "
                "one client at a time may move it; wait until that one has finished, "
                "or end it"
            )
        self._holder = Holder(name, peer)
        return self._holder

    def is_held_by(self, lease: str) -> bool:
        """Return whether this is the lease of the holder."""
        held = self._holder
        return held is not None and secrets.compare_digest(
            held.lease.encode(), lease.encode()
        )

    def require(self, lease: str) -> Holder:
        """Return the holder that shows this lease.

        Raises:
            ArmError: The lease is unknown or has ended; says why.
        """
        held = self._holder
        if held is None or not self.is_held_by(lease):
            now = f"; now {held} holds the arm" if held is not None else ""
            raise ArmError(
                "this client does not hold the arm's lease: "
                + (f"{self._last}{now}" if lease else "acquire it first")
            )
        return held

    def end(self, holder: Holder, reason: str) -> None:
        """End a lease; nothing happens if it has ended already."""
        if self._holder is not holder:
            return
        self._last = f"the lease of {holder} has ended ({reason})"
        self._holder = None
        self._on_end(holder, reason)

    def close(self) -> None:
        """End the lease, if there is one."""
        if self._holder is not None:
            self.end(self._holder, "the service has closed")
