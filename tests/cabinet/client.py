"""A scripted FRI client on real UDP, made of the codec alone."""

import select
import socket
import threading
import time

from dovetail import _core
from dovetail.cabinet.protocol import SessionState

ZERO = [0.0] * 7
WAIT, ACTIVE = SessionState.COMMANDING_WAIT, SessionState.COMMANDING_ACTIVE


def mirror(message):
    """Answer as a well-behaved torque client at rest does; None says nothing."""
    state = int(message.state)
    if state == SessionState.IDLE:
        return None
    command = _core.FriCommand()
    if state >= WAIT:
        command.q = message.ipo_q if state == WAIT else message.q_measured
        command.tau = ZERO
    return command


class Client:
    """Answers each message in a thread, by a function that tests may exchange."""

    def __init__(self, version="1.15", answer=mirror, port=0):
        self.version = _core.fri_version(version)
        self.answer = answer
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", port))
        self.address = self.socket.getsockname()
        self.multiplier = 1
        self.states = []
        """Session states in the order seen, without repetitions."""
        self.messages = []
        """Every message that could be read."""
        self.undecodable = 0
        self.error = None
        self.cabinet = None
        self._sequence = 0
        self._unanswered = 0
        self._is_closing = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self):
        self._thread.start()
        return self

    def close(self):
        self._is_closing = True
        if self._thread.is_alive():
            self._thread.join()
        self.socket.close()

    def _run(self):
        while not self._is_closing:
            readable, _, _ = select.select([self.socket], [], [], 0.05)
            if readable:
                self.step()

    def step(self):
        """Receive one datagram and answer it."""
        data, self.cabinet = self.socket.recvfrom(2000)
        try:
            message = _core.FriMonitoring.decode(self.version, data)
        except ValueError as error:
            self.undecodable += 1
            self.error = str(error)
            return None
        self.messages.append(message)
        state = SessionState(int(message.state))
        if not self.states or self.states[-1] is not state:
            self.states.append(state)
        self._unanswered += 1
        if self._unanswered < (message.receive_multiplier or 1):
            return message
        command = self.answer(message)
        if command is not None:
            self.send(command, message.sequence)
        return message

    def send(self, command, reflected):
        self._unanswered = 0
        command.sequence = self._sequence
        command.reflected = reflected
        self._sequence += 1
        self.socket.sendto(command.encode(self.version), self.cabinet)

    @property
    def state(self):
        return self.states[-1] if self.states else None

    def wait_for(self, state, timeout=30.0):
        """Wait until the last message was of a state, or fail."""
        return wait_until(lambda: self.state is state, timeout, lambda: self.states)


def wait_until(condition, timeout=30.0, describe=lambda: ""):
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, f"not within {timeout} s: {describe()}"
        time.sleep(0.002)
