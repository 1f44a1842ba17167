"""What a command prints: nothing in it acts on a terminal, and whoever stops reading doesn't end the work."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from holoview.commands.cli import main
from holoview.commands.console import PrintableStream, SafeStream, console_streams
from holoview.util.text import printable_lines
from tests.patience import PATIENCE_S

SMALL = ["--set", "shape=[24,32]"]


class _Broken(io.StringIO):
    """A stream that takes a few writes and then none."""

    def __init__(self, error: Exception, after: int = 0) -> None:
        super().__init__()
        self._error, self._left = error, after

    def write(self, text: str) -> int:
        self._left -= 1
        if self._left < 0:
            raise self._error
        return super().write(text)


@given(st.lists(st.text(st.characters(codec=None), max_size=30), max_size=5))
@settings(deadline=None, derandomize=True)
def test_all_that_is_printed_is_printable(texts: list[str]) -> None:
    under = io.StringIO()
    stream = PrintableStream(SafeStream(under))
    for text in texts:
        print(text, file=stream)
    assert under.getvalue() == "".join(f"{printable_lines(text)}\n" for text in texts)
    assert "\x1b" not in under.getvalue()


@pytest.mark.parametrize("error", [BrokenPipeError(32, "Broken pipe"), OSError(5, "I/O error"), ValueError("closed")])
@pytest.mark.parametrize("after", [0, 1])
def test_a_stream_that_fails_is_silent_from_then_on(error: Exception, after: int) -> None:
    under = _Broken(error, after)
    stream = SafeStream(under)
    for text in "abc":
        stream.write(text)
    stream.flush()
    assert under.getvalue() == "abc"[:after] and isinstance(stream.error, OSError) and not stream.isatty()


def test_a_stream_that_was_closed_before_the_start_takes_everything() -> None:
    stream = SafeStream(None)
    assert stream.write("abc") == 3 and stream.error is None and not stream.isatty()
    stream.flush()


def test_the_streams_are_as_before_afterwards() -> None:
    before = sys.stdout, sys.stderr
    with pytest.raises(RuntimeError), console_streams():
        assert sys.stdout is not before[0]
        raise RuntimeError
    assert (sys.stdout, sys.stderr) == before


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX shell")
@pytest.mark.parametrize(
    ("redirection", "code", "told"),
    [
        pytest.param("| head -1", 0, "", marks=pytest.mark.explores),
        pytest.param(">&- 2>&-", 0, "", marks=pytest.mark.explores),
        (">/dev/full", 2, "holoview: output: No space left on device\n"),
        pytest.param(">&-", 0, "", marks=pytest.mark.explores),
        pytest.param("2>&-", 0, "", marks=pytest.mark.explores),
    ],
)
def test_output_that_goes_nowhere_makes_no_traceback(redirection: str, code: int, told: str) -> None:
    if "full" in redirection and not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    command = f"set -o pipefail; {sys.executable} -m holoview info holochrome-8 {redirection}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stderr) == (code, told)


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_reader_that_goes_doesn_t_end_the_work(
    picture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stream: str
) -> None:
    """Neither of its progress nor of its results: `export` writes the second file after printing the first."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("holoview.commands.console.LINE_INTERVAL_S", 0.0)
    monkeypatch.setattr(sys, stream, _Broken(BrokenPipeError(32, "Broken pipe")))
    assert main(["optimise", "simultaneous", str(picture), *SMALL, "--iterations", "2", "-o", "h.safetensors"]) == 0
    assert main(["export", "h.safetensors", "--png", "out"]) == 0
    written = {"slm1.png", "slm2.png", "test.png", "patterns.json"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == written


def test_warnings_of_libraries_don_t_precede_the_message() -> None:
    program = "import logging, sys, warnings; from holoview import cli; from holoview.__main__ import run\n"
    program += (
        "def main(words): warnings.warn('a bomb'); import logging; "
        "logging.getLogger('tifffile').warning('odd'); return 3\n"
    )
    program += "cli.main = main; sys.exit(run())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stderr) == (3, "")
    done = subprocess.run(
        [sys.executable, "-W", "default", "-c", program], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 3 and "a bomb" in done.stderr
