"""Drives a bake to its end without holding up whoever shows its progress."""

from __future__ import annotations

import threading
from collections.abc import Callable

from .bake import Baked, BakeJob
from .core.errors import Cancelled

POLL_SECONDS = 0.05


class Runner:
    """A job on a worker thread, or in slices on this thread where the device needs it (a GPU context belongs
    to the main thread). `finish(baked)`, to write files, is always called on a worker thread; what it
    returns, if anything, is the result. `step` and `stop` are to be called from the thread that made the
    runner."""

    def __init__(self, job: BakeJob, finish: Callable[[Baked], Baked | None] | None = None):
        self.job = job
        self._finish = finish
        self._result: Baked | None = None
        self._failure: BaseException | None = None
        self._thread = None if job.needs_main_thread else self._started_thread()

    def _started_thread(self) -> threading.Thread:
        thread = threading.Thread(target=self._work, name="strata-bake")
        thread.start()
        return thread

    def _work(self) -> None:
        try:
            baked = self.job.result()
            finished = self._finish(baked) if self._finish else None
            self._result = finished or baked
        except BaseException as failure:  # a panic of the kernels is no Exception
            self._failure = failure

    def step(self, seconds: float = POLL_SECONDS) -> Baked | None:
        """Waits or works for about `seconds`; the result once all is done. Raises what the bake raised."""
        if self._thread is None:
            if self.job.advance(seconds):
                self._thread = self._started_thread()
            return None
        self._thread.join(seconds)
        if self._thread.is_alive():
            return None
        if self._failure is not None:
            raise self._failure
        return self._result

    def cancel(self) -> None:
        """Asks the bake to stop; the next `step` that finds it stopped raises Cancelled."""
        self.job.cancel()

    def stop(self) -> None:
        """Cancels and waits until nothing of the bake runs any more. Does nothing after its end."""
        self.cancel()
        if self._thread is not None:
            self._thread.join()


def run_to_end(
    job: BakeJob,
    finish: Callable[[Baked], Baked | None] | None = None,
    show: Callable[[float, str, float | None], None] | None = None,
) -> Baked:
    """Bakes and finishes, telling `show` the share done, the stage and the seconds left (None: not known).
    Whatever interrupts it, Ctrl-C too, no thread of it is left behind. Raises Cancelled and what the bake or
    `finish` raises."""
    runner = Runner(job, finish)
    try:
        while (baked := runner.step()) is None:
            if show:
                show(job.progress, job.stage, job.seconds_left)
        return baked
    except KeyboardInterrupt:
        raise Cancelled() from None
    finally:
        runner.stop()
