"""What several tests need: devices that must be there when CI says so, the zip, a screen."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from strata.tests.support.places import ROOT

os.environ.setdefault("STRATA_CACHE", "")  # nothing of a test is kept in the user's
if worker := os.environ.get("PYTEST_XDIST_WORKER"):
    # Mesa maps its cache of shaders into memory: another process that trims it ends this one with SIGBUS.
    os.environ["MESA_SHADER_CACHE_DIR"] = str(ROOT / "out" / "shaders" / worker)


@pytest.fixture(params=["cpu", "gpu"])
def backend(request) -> str:
    """Each device in turn. Without a GPU its tests are skipped, or fail if STRATA_EXPECT_GPU is 1."""
    if request.param == "gpu":
        from strata.tests.support.gpu_scenes import gpu_device

        gpu_device()
    return request.param


@pytest.fixture(scope="session")
def archive() -> Path:
    """The extension's zip, built now."""
    subprocess.run([sys.executable, "-m", "strata.scripts.build.extension"], check=True)
    (found,) = (ROOT / "dist").glob("strata-*-linux_x64.zip")
    return found


@pytest.fixture
def display():
    """A screen without a monitor; its number is chosen by the server."""
    readable, writable = os.pipe()
    command = ["Xvfb", "-displayfd", str(writable), "-screen", "0", "1400x900x24", "+extension", "GLX"]
    with subprocess.Popen(command, pass_fds=[writable], stderr=subprocess.DEVNULL) as server:
        os.close(writable)
        with open(readable) as told:
            number = told.readline().strip()
        assert number, "Xvfb did not start"
        yield f":{number}"
        server.terminate()


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    session.config.exit_code = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """Ends the process before Python takes Blender's module apart: with a GPU context and hundreds of opened
    files behind it that has crashed after the last test. Exit codes of real runs are tested in processes of
    their own (test_cli.py)."""
    if hasattr(config, "exit_code"):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.exit_code)
