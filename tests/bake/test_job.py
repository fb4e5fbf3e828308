"""A bake on its worker thread: cancelled at any moment, it stops at once and leaves no thread."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace

import pytest
import strata_kernels
from strata.addon.bake import SHOWING_SECONDS, BakeJob, read_scene
from strata.addon.core.errors import Cancelled, StrataError
from strata.addon.devices.cpu import CpuDevice
from strata.addon.job import Runner, run_to_end
from strata.addon.planning import Options
from strata.addon.scene.open import choose, open_blend
from strata.tests.support.places import SAMPLES

# 0.2 s is the promise; this is of the processor, whatever else it works at, and of all its cores.
SECONDS_TO_STOP = 1.0


def new_job(**options) -> BakeJob:
    open_blend(SAMPLES / "courtyard.blend")
    chosen = choose()
    options = Options(backend="cpu", **options)
    *read, _ = read_scene(chosen.scene, chosen.view_layer, options, size=(320, 180))
    return BakeJob(*read, options)


def threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("strata")]


def wait_until_stopped(runner: Runner) -> None:
    """For a cancelled bake."""
    while runner.step(0.01) is None:
        pass


# While it looks at the scene coarsely, builds maps, and evaluates the first of many samples.
@pytest.mark.parametrize("wait", [0.0, 0.1, 0.3, 1.0])
def test_cancel_stops_at_once(wait):
    runner = Runner(new_job(samples=4096), finish=lambda baked: pytest.fail("a cancelled bake has no result"))
    time.sleep(wait)
    started = time.process_time()
    runner.cancel()
    with pytest.raises(Cancelled):
        wait_until_stopped(runner)
    assert time.process_time() - started < SECONDS_TO_STOP
    assert threads() == []


def test_cancel_stops_while_measuring():
    runner = Runner(new_job(samples=1, probes=1 << 18))
    while runner.job.stage != "Measuring":
        assert runner.step(0.01) is None
    started = time.process_time()
    runner.cancel()
    with pytest.raises(Cancelled):
        wait_until_stopped(runner)
    assert time.process_time() - started < SECONDS_TO_STOP


def test_a_kernel_that_cannot_stop_is_left_to_itself():
    """What it returns, or raises, comes through; once cancelled, nobody waits for it."""
    device = CpuDevice()
    assert device.unless_cancelled(lambda: 7) == 7
    with pytest.raises(ZeroDivisionError):
        device.unless_cancelled(lambda: 1 // 0)
    ended = threading.Event()
    threading.Timer(0.05, device.cancel_flag.set).start()
    with pytest.raises(strata_kernels.Cancelled):
        device.unless_cancelled(lambda: ended.wait(60.0))
    ended.set()


def test_ctrl_c_between_two_looks_cancels_and_waits():
    def interrupt(share, stage, seconds_left):
        raise KeyboardInterrupt

    with pytest.raises(Cancelled):
        run_to_end(new_job(samples=4096), show=interrupt)
    assert threads() == []


def test_what_fails_while_finishing_reaches_the_caller():
    def full_disk(baked):
        assert threading.current_thread() is not threading.main_thread()
        raise StrataError("cannot write x.exr: No space left on device")

    with pytest.raises(StrataError, match="No space"):
        run_to_end(new_job(samples=1, probes=0), finish=full_disk)
    assert threads() == []


def test_the_time_left_rises_where_steps_take_longer_and_progress_never_falls():
    job = new_job(samples=64, probes=0)
    while job.stage != "Baking" or job.seconds_left is None:
        assert not job.advance(0.0)
    done = job.progress
    job._forecasts = [SimpleNamespace(seconds_left=lambda: 1000.0)]
    time.sleep(SHOWING_SECONDS)
    assert not job.advance(0.0)
    assert 990.0 < job.seconds_left <= 1000.0
    assert job.progress == done
    job._shown -= 100.0  # nothing has come back for so long
    assert job.seconds_left == pytest.approx(900.0, abs=10.0)
    job._shown -= 1000.0
    assert job.seconds_left == 500.0
    job.cancel()
