"""The command `dovetail`: finds the subcommand, runs it, and words its errors."""

import errno
import importlib
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.text import Text

import dovetail
from dovetail.errors import ConfigError, DovetailError, UnprovenWarning, did_you_mean
from dovetail.interrupt import INTERRUPTED
from dovetail.plugins import trust_typed
from dovetail.printable import printable

COMMANDS = {
    "demo": ("Demo", "try the shipped policy on a twin: the main job"),
    "train": ("Train", "train a policy in a simulation or on an arm"),
    "export": ("Export", "write a model of Stable-Baselines3 or SBX as a policy"),
    "part": ("Part", "check two meshes and make a part of them to train on"),
    "evaluate": ("Evaluate", "try a policy on a plant, a twin or an arm"),
    "compare": ("Compare", "say which of several policies is better"),
    "cockpit": ("Cockpit", "see an arm in the browser, and touch it"),
    "record": ("Record", "show the task by hand, for a policy to learn from"),
    "replay": ("Replay", "show recorded episodes in the browser"),
    "identify": ("Identify", "fit the simulation to an arm's scripted motions"),
    "reproduce": ("Reproduce", "run the paper's experiments, resumable"),
    "serve": ("Serve", "offer an arm to learners over gRPC"),
    "twin": ("Twin", "list the twins, or show one"),
    "cabinet": ("Cabinet", "simulate a robot behind KUKA's FRI"),
    "camera": ("Camera", "print a board, calibrate a camera, watch what it sees"),
    "gripper": ("Gripper", "drive a WSG 50, or simulate one"),
    "doctor": ("Doctor", "check this installation, or an arm"),
}
"""Subcommands: the settings class in `dovetail.commands.<name>`, and what it does.

A subcommand's file is imported only when it is asked for, so that the learning stack
is not needed, nor waited for, by the others.
"""

_OFFERS_ARM = ("serve", "cabinet")
"""Those that offer an arm and have no tracker of the fixture."""

_NO_OUTPUT = (errno.ENOSPC, errno.EDQUOT, errno.EPIPE, errno.EIO)
"""Error numbers of the standard output: a full device, a reader that has gone."""


def main(argv: Sequence[str] | None = None) -> None:
    """Run `dovetail` with command-line words and leave with its exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    # Commands draw into files only, and an unknown name ends Matplotlib's import.
    os.environ["MPLBACKEND"] = "agg"
    try:
        try:
            code = run(words)
        finally:
            sys.stdout.flush()  # a full disk shows here, not after the last line
    except OSError as error:
        if error.filename is not None or error.errno not in _NO_OUTPUT:
            raise
        reason = os.strerror(error.errno or 0).lower()
        print(f"dovetail: cannot write the output: {reason}", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 2
    if code == INTERRUPTED and "jax" in sys.modules:
        # A run is closed by now, and Python's own end walks all of JAX for seconds.
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def run(words: list[str]) -> int:
    """Run one command line.

    Args:
        words: The command line without the program's name. `--debug` anywhere shows
            the traceback of an error.

    Returns:
        0 when it went well, 2 on a wrong setting or input, 130 when interrupted;
        `doctor` gives 1 when something essential is broken, `reproduce` when an
        experiment failed.
    """
    is_debug = "--debug" in words
    words = [word for word in words if word != "--debug"]
    try:
        with _tokens_aside(words) as words:
            return _run(words)
    except DovetailError as error:
        if is_debug:
            raise
        print(f"dovetail: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("dovetail: interrupted", file=sys.stderr)
        return INTERRUPTED


@contextmanager
def _tokens_aside(words: list[str]) -> Iterator[list[str]]:
    """Move the token of a service's address into this process's environment.

    Addresses are shown on pages, in messages and in logs; children inherit it.
    """
    if not any("token=" in word for word in words):
        yield words
        return
    from dovetail.arms.remote_arm import split_token
    from dovetail.rpc.token import TOKEN

    before, kept = os.environ.get(TOKEN), []
    for word in words:
        text, token = split_token(word) if "grpc://" in word else (word, "")
        kept.append(text)
        if token:
            os.environ[TOKEN] = token
    try:
        yield kept
    finally:
        os.environ.pop(TOKEN, None)
        if before is not None:
            os.environ[TOKEN] = before


def _run(words: list[str]) -> int:
    if words in (["--version"], ["-V"]):
        print(f"dovetail {dovetail.__version__}")
        return 0
    if not words or words[0] in ("-h", "--help"):
        print(_help())
        return 0 if words else 2
    return _run_command(words[0], words[1:])


def _run_command(name: str, words: list[str]) -> int:
    if name not in COMMANDS:
        raise DovetailError(
            f"unknown command {name!r}{did_you_mean(name, COMMANDS)}; known commands: "
            f"{', '.join(COMMANDS)}"
        )
    if name in _OFFERS_ARM and any(w.partition("=")[0] == "--tracker" for w in words):
        raise ConfigError(
            f"{name} offers an arm; the camera is on the side of the policy: give "
            "--tracker to `dovetail evaluate` or `dovetail train` with the address of "
            "this arm"
        )
    from dovetail.commands.command_line import find_task, parse

    warnings.simplefilter("ignore", UnprovenWarning)  # a command says it itself
    trust_typed(words)
    module = importlib.import_module(f"dovetail.commands.{name}")
    settings = vars(module)[COMMANDS[name][0]]
    find = vars(module).get("given_before")
    before = find(words) if find else {}
    given = parse(
        settings,
        words,
        find_task(words, before["env"]) if "env" in before else None,
        prog=f"dovetail {name}",
        common=vars(module).get("COMMON", ()),
        before=before,
    )
    return given.run(make_console())


class Terminal(Console):
    """A terminal on which a text cannot do more than stand there."""

    def __init__(self, **options: Any) -> None:
        """Take options of `Console`; [brackets] and :colons: are left alone."""
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Return text ready to be shown, also where it quotes a file or a service."""
        return super().render_str(printable(text, keep="\n\t"), **options)


def make_console() -> Console:
    """Return the terminal that commands write to."""
    return Terminal()


def _help() -> str:
    lines = [f"  {name:10}{text}" for name, (_, text) in COMMANDS.items()]
    return "\n".join(
        [
            "usage: dovetail COMMAND [OPTIONS]",
            "",
            *lines,
            "",
            "dovetail COMMAND --help lists the options, --help-all says more of each;",
            "--debug shows tracebacks;",
            "dovetail --version tells the version",
        ]
    )


if __name__ == "__main__":
    main()
