"""`dovetail evaluate` on a service: the token opens it, and is in no file."""

from rich.console import Console

from dovetail.arms.remote_arm import GrpcAddress
from dovetail.evaluation.compare import ComparisonConfig, compare
from dovetail.evaluation.config import EvaluationConfig
from dovetail.evaluation.evaluate import evaluate


def test_the_address_with_the_token_is_enough_and_the_token_is_written_nowhere(
    simulation, tmp_path
):
    out = tmp_path / "out"
    config = EvaluationConfig(
        policy="peg_square", arm=simulation.url, tries=1, out=out, accept_contact=True
    )
    evaluate(config, Console(quiet=True))
    token = GrpcAddress.parse(simulation.url).token
    assert token
    files = [path for path in out.rglob("*") if path.is_file()]
    assert any(simulation.address.encode() in path.read_bytes() for path in files)
    assert not [path for path in files if token.encode() in path.read_bytes()]


def test_policies_take_turns_at_the_one_arm_of_a_service(simulation, tmp_path):
    config = ComparisonConfig(
        policies=("peg_square", "peg_near"),
        arm=simulation.url,
        tries=6,
        out=tmp_path / "out",
        accept_contact=True,
    )
    found = compare(config, Console(quiet=True))
    assert [row.tries for row in found.rows] == [5, 5]
    assert found.results[0].verdict == "no answer"
