"""In lockstep a message that nobody answers comes again, whoever else is asking."""

import time

from dovetail.cabinet.protocol import SessionState

from .client import mirror


def test_questions_for_the_status_do_not_keep_a_message_from_being_repeated(
    make, client
):
    cabinet = make()
    cabinet.start()
    client.start().wait_for(SessionState.COMMANDING_ACTIVE)
    client.answer = lambda message: None  # it thinks for a long time
    seen = len(client.messages)
    end = time.monotonic() + 1.8
    while time.monotonic() < end:
        assert cabinet.request({"do": "status"})["ok"]
        time.sleep(0.02)
    numbers = [message.sequence for message in client.messages[seen:]]
    assert numbers.count(numbers[-1]) >= 3
    client.answer = mirror
    client.wait_for(SessionState.COMMANDING_ACTIVE)
