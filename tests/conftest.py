import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import matplotlib as mpl
import pytest
from hypothesis import HealthCheck, settings

# A busy machine is slow; and no example is kept, so that a seed says all.
COMMON = {
    "database": None,
    "deadline": None,
    "print_blob": True,
    "suppress_health_check": [HealthCheck.too_slow],
}
settings.register_profile("house", derandomize=True, **COMMON)
settings.register_profile("fuzz", derandomize=False, **COMMON)
settings.load_profile("house")

mpl.use("Agg")

# A shell's job in the background ignores interrupts, and so would every process started here.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Work in an empty directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def pressing():
    """Press Ctrl-C when this process has worked for some seconds, and tell how long since then.

    It is processor time: another process that takes the processor changes nothing.
    """

    @contextmanager
    def press(seconds):
        begin = time.process_time()
        before = signal.signal(signal.SIGPROF, signal.default_int_handler)
        signal.setitimer(signal.ITIMER_PROF, seconds)
        try:
            yield lambda: time.process_time() - begin - seconds
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.signal(signal.SIGPROF, before)

    return press


@pytest.fixture
def liouville(elsewhere, monkeypatch, capsys):
    """Run commands of ``liouville`` in this process, from an empty directory."""
    from liouville import _cli as cli

    monkeypatch.setattr(sys, "path", list(sys.path))  # a model file's folder is put into it
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for name in ("FORCE_COLOR", "TERM"):
        monkeypatch.delenv(name, raising=False)

    def run(words):
        monkeypatch.setattr(sys, "argv", ["liouville", *words.split()])
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            cli.main()
        return subprocess.CompletedProcess(words, left.value.code or 0, *capsys.readouterr())

    return run


@pytest.fixture
def jax():
    """JAX with numbers of 64 bits; tests that take it are left out where it is not installed."""
    found = pytest.importorskip("jax", reason="JAX is not installed")
    found.config.update("jax_enable_x64", True)
    yield found
    found.config.update("jax_enable_x64", False)


@pytest.fixture
def torch():
    """PyTorch; tests that take it are left out where it is not installed."""
    return pytest.importorskip("torch", reason="PyTorch is not installed")
