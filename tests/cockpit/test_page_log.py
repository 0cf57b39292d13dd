"""A terminal that stands still keeps no thread of the page waiting."""

import logging
import threading
import time

from dovetail.cockpit.page_log import LOG, PageLog


class Still(logging.Handler):
    """A terminal after Ctrl-S, until `moves` is set."""

    def __init__(self):
        super().__init__()
        self.moves = threading.Event()
        self.lines = []

    def emit(self, record):
        self.moves.wait(20)
        self.lines.append(record.getMessage())


def test_who_logs_waits_for_no_terminal_and_nothing_is_lost_but_a_flood(monkeypatch):
    monkeypatch.setattr(LOG, "handlers", [])  # of other pages in this process
    terminal = Still()
    logging.getLogger().addHandler(terminal)
    log = PageLog()
    try:
        begin = time.monotonic()
        for i in range(1000):
            LOG.warning("line %d", i)
        assert time.monotonic() - begin < 5.0
        assert terminal.lines == []
        terminal.moves.set()
    finally:
        terminal.moves.set()
        log.close()
        logging.getLogger().removeHandler(terminal)
    assert terminal.lines[:100] == [f"line {i}" for i in range(100)]
    assert len(terminal.lines) < 200
    assert LOG.propagate
