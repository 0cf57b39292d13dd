"""Files that mean harm, each read by the command that takes such: refused, and at once.

All run in one process, which starts no learner and no server. Of each the exit code,
the processor's time and the peak of memory are taken; what waits is ended by an alarm.
The table of them is `hostile-files-*.txt` in pytest's folder.
"""

import hashlib
import io
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dovetail.episode import Episode, unit_of
from dovetail.learn.config import TrainConfig
from dovetail.learn.config_file import to_toml
from dovetail.learn.policy import Policy, find_policy
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.plants.twin import load_twin
from extras import need

SECONDS = 5.0
MEMORY = 1e9
"""Largest peak of the process, everything that it imports included [bytes]."""
MB = 1_000_000

CHILD = """
import contextlib, importlib, io, json, os, resource, signal, sys, time, traceback
from pathlib import Path
from dovetail import cli
from dovetail.errors import DovetailError

def peak():
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return 1024 * int(line.split()[1])

class Late(BaseException):
    pass

def late(*_):
    raise Late("over 60 s")

def refused(words):
    if not words[0].startswith("call:"):
        return cli.run(words)
    module, name = words[0].removeprefix("call:").split(":")
    function = importlib.import_module(module)
    for part in name.split("."):
        function = getattr(function, part)
    try:
        function(Path(words[1]), *words[2:])
    except (DovetailError, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0

signal.signal(signal.SIGALRM, late)
for name in ("learn.config", "evaluation.evaluate", "commands.replay", "identify.fit"):
    importlib.import_module(f"dovetail.{name}")  # start-up time does not count
size = 1024 * int(Path("/proc/self/status").read_text().split("VmSize:")[1].split()[0])
resource.setrlimit(resource.RLIMIT_AS, (size + 4 * 2**30,) * 2)
for line in sys.stdin:
    name, words = json.loads(line)
    Path("/proc/self/clear_refs").write_text("5")
    begin, code, errors = time.process_time(), None, io.StringIO()
    signal.alarm(60)
    try:
        with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(errors):
            code = refused(words)
    except SystemExit as error:  # tyro ends so
        code = error.code
    except BaseException:
        traceback.print_exc(file=errors)
    signal.alarm(0)
    took = time.process_time() - begin
    print(json.dumps([name, code, took, peak(), errors.getvalue()]), flush=True)
"""


def _zero(path):
    path.symlink_to("/dev/zero")


def _pipe(path):
    os.mkfifo(path)


def _folder(path):
    path.mkdir()


def _terabyte(path):
    with path.open("wb") as file:
        file.truncate(2**40)


def _gone(path):
    path.symlink_to(path.with_name("not there"))


def _empty(path):
    path.write_bytes(b"")


def _noise(path):
    path.write_bytes(np.random.default_rng(0).bytes(100_000))


ANYWHERE = (_zero, _pipe, _folder, _terabyte, _gone, _empty, _noise)

JSONS = {
    "deep": "[" * 100_000,
    "deep-table": '{"a":' * 5000 + "1" + "}" * 5000,
    "digits": "9" * MB,
    "large": "[" + "[]," * 6_000_000 + "1]",
    "many": "[" + "[0]," * 1_900_000 + "1]",
    "list": "[1]",
    "surrogate": '{"format": "\\ud800"}',
    "long-number": '{"format": 1' + "0" * 400 + "}",
}

TOMLS = {
    "digits": "a = " + "9" * 250_000,
    "million-digits": "a = " + "9" * MB,
    "hex": "pivot = 0x" + "f" * 20_000,
    "hex-setting": "seed = 0x" + "f" * 20_000,
    "dotted": ".".join("k" * 50_000) + " = 1",
    "dotted-quoted": ".".join(['"="'] * 50_000) + " = 1",
    "dotted-comment": '"#".' + ".".join("k" * 50_000) + " = 1",
    "dotted-many": "\n".join("a." * 99 + f"b{i} = 1" for i in range(1400)),
    "header": "[" + ".".join("k" * 50_000) + "]",
    "arrays": "a = " + "[" * 50_000,
    "tables": "a = " + "{a = " * 5000,
    "latin": "a = '\xff'",
    "date": "damping = 1979-05-27",
    "infinite": "damping = inf",
    "nested-type": "description = [[1]]",
}


def _npy(header, body=b""):
    text = header.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + body


def _numbers(shape, kind="<f8"):
    return f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}}}"


def _packed(path, members, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method, compresslevel=1) as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def _array(values):
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def _log(path, **changed):
    """Write an NPZ that has the parts of a log, some of them changed."""
    parts = {
        "columns.npy": _array(np.array(["time"])),
        "units.npy": _array(np.array(["s"])),
        "metadata.npy": _array(np.array('{"format": 1}')),
        "data.npy": _array(np.zeros((1, 1))),
    }
    _packed(path, parts | {f"{name}.npy": part for name, part in changed.items()})


def _declares_less(path, name):
    """Declare 200 bytes as the size of a ZIP member that unpacks to more."""
    content = bytearray(path.read_bytes())
    for mark, at in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        begin = -1
        while (begin := content.find(mark, begin + 1)) >= 0:
            if content[begin : begin + 120].find(name) >= 0:
                content[begin + at : begin + at + 4] = (200).to_bytes(4, "little")
    path.write_bytes(content)


def _npz_bomb(path):
    _log(path, data=_npy(_numbers("(50000000, 1)"), bytes(400 * MB)))


def _npz_largest(path):
    """As large as is allowed, and copied, as a log of old lacks the wrench."""
    names = [*CYCLE_COLUMNS[:-6], "step", "reward"]
    rows = 295 * MB // 8 // len(names)
    numbers = _npy(_numbers(f"({rows}, {len(names)})"), bytes(8 * len(names) * rows))
    units = [unit_of(name) for name in names]
    _log(path, columns=_array(names), units=_array(units), data=numbers)


def _npz_bomb_in_text(path):
    _log(path, columns=_npy(_numbers("(1,)", "<U70000000"), bytes(280 * MB)))


def _npz_lies(path):
    _log(path, metadata=_npy(_numbers("(1,)", "<f8"), bytes(400 * MB)))
    _declares_less(path, b"metadata.npy")


def _npz_shape(path):
    _log(path, data=_npy(_numbers("(1000000000000, 1)")))


def _npz_negative(path):
    _log(path, data=_npy(_numbers("(-1, 1)")))


def _npz_nothing(path):
    _log(path, columns=_npy(_numbers("(1000000000000,)", "<U0")))


def _npz_pickle(path):
    _log(path, data=_array(np.array([{}], dtype=object)))


def _npz_record(path):
    _log(path, data=_npy(_numbers("(1,)", [("a", "<f8", (10**9,))])))


def _npz_header(path):
    _log(path, data=_npy("-" * 9000 + "1"))


def _npz_many(path):
    _packed(path, {f"{i}.npy": b"" for i in range(100_000)})


def _npz_lzma(path):
    _log(path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_LZMA) as archive:
        archive.writestr("extra.npy", b"")
    with zipfile.ZipFile(path) as archive:
        parts = {n: archive.read(n) for n in archive.namelist() if n != "extra.npy"}
    _packed(path, parts, zipfile.ZIP_LZMA)


def _npz_metadata(path):
    _log(path, metadata=_array(np.array("[" * 100_000)))


NPZS = {
    name.removeprefix("_npz_"): function
    for name, function in dict(globals()).items()
    if name.startswith("_npz_")
}


def _parquet(path, rows, columns=48, method="SNAPPY", groups=1):
    pyarrow, parquet = need("pyarrow"), need("pyarrow.parquet")
    zeros = pyarrow.array(np.zeros(rows))
    names = [f"c{i}" for i in range(columns)]
    table = pyarrow.Table.from_arrays([zeros] * columns, names=names)
    size = max(1, rows // groups)
    parquet.write_table(table, path, compression=method, row_group_size=size)


def _parquet_text(path):
    pyarrow, parquet = need("pyarrow"), need("pyarrow.parquet")
    parquet.write_table(pyarrow.table({"time": ["x" * 1000] * 1000}), path)


def _parquet_largest(path):
    """As large as is allowed, of zeros that Snappy makes small."""
    pyarrow, parquet = need("pyarrow"), need("pyarrow.parquet")
    rows = 295 * MB // 8 // len(CYCLE_COLUMNS)
    zeros, unit = pyarrow.array(np.zeros(rows)), {"unit": "1"}
    fields = [pyarrow.field(n, zeros.type, metadata=unit) for n in CYCLE_COLUMNS]
    schema = pyarrow.schema(fields, metadata={"dovetail": '{"format": 1}'})
    table = pyarrow.Table.from_arrays([zeros] * len(fields), schema=schema)
    parquet.write_table(table, path, use_dictionary=False, data_page_size=2**30)


def _parquet_footer(path):
    _parquet(path, 10)
    content = path.read_bytes()
    path.write_bytes(content[:-8] + (2**31 - 1).to_bytes(4, "little") + b"PAR1")


PARQUETS = {
    "bomb": lambda path: _parquet(path, 3_000_000),
    "bomb-zstd": lambda path: _parquet(path, 700_000, 48, "ZSTD"),
    "bomb-gzip": lambda path: _parquet(path, 100_000, 48, "GZIP"),
    "one-column": lambda path: _parquet(path, 30_000_000, 1),
    "many-columns": lambda path: _parquet(path, 1, 5000),
    "many-groups": lambda path: _parquet(path, 20_000, 1, "NONE", 20_000),
    "text": _parquet_text,
    "footer": _parquet_footer,
    "largest": _parquet_largest,
}


def _tensors(header, body=b""):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + body


def _tensor(shape, end, kind="F32"):
    entry = {"dtype": kind, "shape": shape, "data_offsets": [0, end]}
    return {"layer0.weight": entry, "layer0.bias": entry}


WEIGHTS = {
    "header": (2**62).to_bytes(8, "little") + b"{}",
    "header-long": _tensors(b"[" * 2 * MB),
    "terabytes": _tensors(_tensor([10**6, 10**6], 4), bytes(4)),
    "shared": _tensors(_tensor([1], 4), bytes(4)),
    "overflow": _tensors(_tensor([2**62, 8], 0)),
    "nothing": _tensors(_tensor([0, 10**12], 0)),
    "half": _tensors(_tensor([1, 2], 4, "BF16"), bytes(4)),
    "many": _tensors({str(i): _tensor([0], 0)["layer0.bias"] for i in range(15_000)}),
}


def _model(path, data, **members):
    _packed(path, {"data": data, "_stable_baselines3_version": "2.9.2", **members})


def _doubling(times=34):
    """Return a pickle of a class whose name doubles so many times by its memo."""
    return b"\x80\x04]\x94" + b"(h\x00h\x00l\x94" * times + b"."


def _zip_class(path):
    import base64

    entry = {
        ":type:": "<class 'abc.ABCMeta'>",
        ":serialized:": base64.b64encode(_doubling()).decode(),
        "__module__": "stable_baselines3.common.policies",
    }
    _model(path, json.dumps({"policy_class": entry, "use_sde": False}))


def _zip_bomb(path):
    _model(path, b" " * (300 * MB))


def _zip_data(path):
    _model(path, b" " * (100 * MB))


def _zip_lies(path):
    _model(path, b" " * (400 * MB))
    _declares_less(path, b"data")


def _zip_many(path):
    _packed(path, {f"{i}": b"" for i in range(100_000)})


def _zip_twice(path):
    _packed(path, {"data": "{}", "dat2": "{}"})
    path.write_bytes(path.read_bytes().replace(b"dat2", b"data"))


def _zip_deep(path):
    _model(path, JSONS["deep"])


def _zip_list(path):
    _model(path, "[]")


def _zip_discrete(path):
    box = {":type:": "<class 'gymnasium.spaces.box.Box'>", "_shape": "[14]"}
    data = {
        "policy_class": {"__module__": "stable_baselines3.common.policies"},
        "use_sde": False,
        "observation_space": box,
        "action_space": {":type:": "<class 'x.Discrete'>", "n": "9" * 5000},
    }
    _model(path, json.dumps(data))


ZIPS = {
    name.removeprefix("_zip_"): function
    for name, function in dict(globals()).items()
    if name.startswith("_zip_")
}


class Cases:
    """Words of each case, and the files that they name."""

    def __init__(self, root):
        """Take a folder for the files."""
        self.root, self.words = root, {}

    def room(self, name):
        """Return a new folder for a case."""
        folder = self.root / name.replace("/", "_")
        folder.mkdir()
        return folder

    def add(self, name, file, write, *words):
        """Write a file, by a function or as it is; `words` are the command line."""
        if callable(write):
            write(file)
        else:
            file.write_bytes(
                write.encode("latin-1") if isinstance(write, str) else write
            )
        self.words[name] = [str(word) for word in words]

    def add_all(self, name, file_name, words, kinds):
        """Add a case for each kind of file; `words` get its path."""
        for kind, write in kinds.items():
            file = self.room(f"{name}-{kind}") / file_name
            self.add(f"{name}-{kind}", file, write, *words(file))


def anywhere(*left_out):
    """Return the kinds of what is no file of any sort."""
    kinds = {kind.__name__[1:]: kind for kind in ANYWHERE}
    return {name: kind for name, kind in kinds.items() if name not in left_out}


def add_policies(cases):
    policy = find_policy("peg_square")
    end = ("--tries", 1, "--plant", "mujoco", "--out")

    def pair(name, kind, sidecar=None, weights=None):
        folder = cases.room(f"{name}-{kind}")
        files = folder / "p.json", folder / "p.safetensors"
        shutil.copy(policy.with_suffix(".json"), files[0])
        shutil.copy(policy, files[1])
        changed = files[0] if sidecar is not None else files[1]
        changed.unlink()
        write = weights if sidecar is None else sidecar
        words = "evaluate", folder / "p.json", *end, folder / "out"
        cases.add(f"{name}-{kind}", changed, write, *words)
        if isinstance(weights, bytes):  # its partner says that it is right
            metadata = json.loads(files[0].read_text())
            metadata["sha256"] = hashlib.sha256(weights).hexdigest()
            files[0].write_text(json.dumps(metadata))

    for kind, write in (anywhere() | JSONS).items():
        pair("policy-json", kind, sidecar=write)
    for kind, write in (anywhere() | WEIGHTS).items():
        pair("policy-weights", kind, weights=write)
    told = json.loads(policy.with_suffix(".json").read_text())
    for kind, env in {
        "stack": {"stack": 10**9},
        "task": {"task": "X:" * MB},
        "recall": {"recall": [10**9] * 1000},
        "period": {"period": 1e-9},
    }.items():
        pair("policy-env", kind, sidecar=json.dumps(told | {"env": told["env"] | env}))
    for kind, columns in {"empty": [[]], "word": ["x"], "number": 1}.items():
        seen = told["observation"] | {"columns": columns}
        pair("policy-seen", kind, sidecar=json.dumps(told | {"observation": seen}))


def add_twins(cases):
    show = lambda file: ("twin", "show", file)  # noqa: E731
    cases.add_all("twin-show", "t.toml", show, anywhere("empty") | TOMLS)
    own = load_twin("medium").to_toml()
    changed = {
        "huge-integer": own.replace("seed = ", "seed = 0x" + "f" * 300 + " # "),
        "date": own.replace("command_delay = ", "command_delay = 1979-05-27 # "),
        "table": own.replace("command_delay = ", "command_delay = {a = 1} # "),
        "text": own.replace("command_delay = ", "command_delay = 'x' # "),
    }
    cases.add_all("twin-own", "t.toml", show, changed)
    kinds = {"terabyte": _terabyte, "zero": _zero, "hex": TOMLS["hex"]}
    tries = ("--tries", "1", "--out", cases.root / "none")
    words = lambda file: ("evaluate", "peg_square", "--twin", file, *tries)  # noqa: E731
    cases.add_all("evaluate-twin", "t.toml", words, kinds)
    words = lambda file: ("cabinet", "--twin", file)  # noqa: E731
    cases.add_all("cabinet-twin", "t.toml", words, kinds)
    need("sbx")
    words = lambda file: ("train", "--model", file, "--out", file.with_name("o"))  # noqa: E731
    cases.add_all("train-model", "t.toml", words, kinds)


def _whole_log(**told):
    """Return a writer of a valid log with the given metadata."""
    place = {"name": "A", "x": 0.6, "y": 0.0, "z": 0.1, "theta": 0.0}
    facts = {
        "fixture_pose": place | told.pop("place", {}),
        "cell": {"env_id": "dovetail/PegInHole-v0", "robot": "iiwa14"},
        "action": {"axes": ["X", "Y", "Z", "A"]},
    }

    def write(path):
        episode = Episode(metadata=facts | told)
        for step in range(3):
            log = np.zeros((10, len(CYCLE_COLUMNS)))
            log[:, 0] = 0.005 * (np.arange(10) + 10 * step)
            episode.append(log, step, np.zeros(4), 0.0, np.zeros(14))
        episode.save(path)

    return write


def add_logs(cases):
    replay = lambda file: ("replay", file, "--port", "0")  # noqa: E731
    cases.add_all("replay", "l.npz", replay, anywhere() | NPZS)
    record = lambda file: ("record", "--written", file, "--logs", file.with_name("o"))  # noqa: E731
    few = {name: NPZS[name] for name in ("lies", "shape")}
    few |= {"terabyte": _terabyte, "axes": _whole_log(action={"axes": True})}
    need("pyarrow")
    cases.add_all("record", "l.npz", record, few)
    told = {
        "nowhere": _whole_log(place={"x": "\0"}),
        "facing": _whole_log(place={"facing": [None] * 4}),
        "task": _whole_log(cell={"env_id": "os:dovetail/PegInHole-v0"}),
        "robot": _whole_log(cell={"robot": "os:getcwd"}),
    }
    cases.add_all("replay-told", "l.npz", replay, told)
    cases.add_all("replay-parquet", "l.parquet", replay, anywhere() | PARQUETS)


def add_models(cases):
    export = lambda file: ("export", file, "--out", file.with_name("o"))  # noqa: E731
    cases.add_all("export", "m.zip", export, anywhere() | ZIPS)


def add_recordings(cases):
    fit = lambda file: ("identify", "fit", file.parent, "--out", file.with_name("o"))  # noqa: E731
    cases.add_all("recording", "recording.json", fit, anywhere() | JSONS)
    report = lambda file: ("identify", "report", file.parent)  # noqa: E731
    few = {name: JSONS[name] for name in ("deep", "digits", "many", "list")}
    cases.add_all("fit", "fit.json", report, anywhere() | few)

    def half(file, write):
        file.with_name("fit.json").write_text('{"format": 1, "settings": {}}')
        cases.add(
            f"generations-{write}", file, {**anywhere(), **JSONS}[write], *call(file)
        )

    def call(file):
        return "call:cli.test_hostile_files:claim_fit", file.parent

    for kind in ("zero", "terabyte", "noise", "large"):
        half(cases.room(f"generations-{kind}") / "generations.jsonl", kind)


def claim_fit(folder):
    """Go on with a fit; what is no regular file holds no generation."""
    from dovetail.errors import LogError
    from dovetail.identify.fit_folder import FitFolder

    if not FitFolder.claim(folder, {}, resume=True).generations:
        raise LogError("there are none")


def add_runs(cases):
    need("sbx")
    resume = lambda file: ("train", "--resume", "--out", file.parent)  # noqa: E731
    cases.add_all("run", "config.toml", resume, anywhere() | TOMLS)
    settings = to_toml(TrainConfig())

    def lock(file, write):
        file.with_name("config.toml").write_text(settings)
        write(file)

    for kind, write in {"pipe": _pipe, "link": _gone, "zero": _zero}.items():
        file = cases.room(f"lock-{kind}") / ".lock"
        cases.add(f"lock-{kind}", file, lambda f, w=write: lock(f, w), *resume(file))
    call = "call:dovetail.learn.progress:read_progress"
    rows = "step\n" + "1,1,1,1,1,1\n" * 750_000 + "x\n1,1,1,1,1,1\n"
    kinds = {"rows": rows, "wide": "a\n" + "1," * 10 * MB + "\n1\n"}
    kinds |= anywhere("empty", "gone")
    cases.add_all("progress", "progress.csv", lambda file: (call, file), kinds)


def add_scripts(cases):
    words = lambda file: ("cabinet", "--twin", "easy", "--script", file)  # noqa: E731
    kinds = anywhere("empty") | {"long": "2s loss=0.1\n" * 200_000, "digits": "9" * MB}
    cases.add_all("script", "s.txt", words, kinds)


GROUPS = (
    *(add_policies, add_twins, add_logs, add_models),
    *(add_recordings, add_runs, add_scripts),
)


@pytest.mark.timeout(300)
@pytest.mark.parametrize("add", GROUPS, ids=lambda add: add.__name__[4:])
def test_a_hostile_file_is_refused_at_once(add, tmp_path, tmp_path_factory):
    cases = Cases(tmp_path)
    add(cases)
    child = subprocess.run(
        [sys.executable, "-c", CHILD],
        input="".join(json.dumps(case) + "\n" for case in cases.words.items()),
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parent.parent)},
        check=False,
    )
    found = [json.loads(line) for line in child.stdout.splitlines()]
    table = [
        f"{name:32} {code} {took:6.2f} s {peak / MB:5.0f} MB  {said[-60:]!r}\n"
        for name, code, took, peak, said in found
    ]
    file = f"hostile-files-{add.__name__[4:]}.txt"
    (tmp_path_factory.getbasetemp() / file).write_text("".join(table))
    assert [name for name, *_ in found] == [*cases.words], child.stderr
    bad = [
        (name, code, took, peak, said)
        for name, code, took, peak, said in found
        if code != 2 or "Traceback" in said or took > SECONDS or peak > MEMORY
    ]
    assert not bad


def test_a_policy_that_means_no_harm_is_read(tmp_path):
    """The limits leave room: a network ten times as wide as any here."""
    layers = [(np.zeros((14, 2560), "f4"), np.zeros(2560, "f4"))]
    layers.append((np.zeros((2560, 2560), "f4"), np.zeros(2560, "f4")))
    metadata = Policy.load(find_policy("peg_square")).metadata
    network = {"layers": [[14, 2560], [2560, 2560]]}
    metadata |= {"network": {"activation": "relu", "output": "tanh", **network}}
    Policy.load(Policy(layers, metadata).save(tmp_path / "wide"))
