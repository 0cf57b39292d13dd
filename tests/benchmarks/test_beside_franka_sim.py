"""A server that does not come up ends a rehearsal, with what it said."""

import beside_franka_sim
import pytest


@pytest.mark.parametrize("then", ["exit 3", "exec sleep 60"])
def test_what_franka_sim_said_is_shown_where_it_does_not_listen(
    tmp_path, monkeypatch, then
):
    monkeypatch.setattr(beside_franka_sim, "is_listening", lambda _: False)
    monkeypatch.setattr(beside_franka_sim, "BEGINS", 0.6)
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\necho no physics today\n{then}\n")
    python.chmod(0o755)
    has_begun = False
    with (
        pytest.raises(SystemExit) as ended,
        beside_franka_sim.franka_in_step(python),
    ):
        has_begun = True
    assert not has_begun
    assert "no physics today" in str(ended.value.code)
