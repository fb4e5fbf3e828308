"""Runs a report: each setting is baked once to be judged, then several times to be timed, all taking turns,
so that a busy machine hurts all alike."""

from __future__ import annotations

import hashlib
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..audit.grid import Grid
from ..audit.other_blender import Scene, kept_scene, request_of
from ..bake import Baked, BakeJob, read_job
from ..core.errors import StrataError, one_line
from ..core.roles import Role
from ..core.version import VERSION
from ..core.working_space import luminance_of
from ..job import run_to_end
from ..planning import Options
from .cost import counted
from .judge import Judge
from .ledger import Ledger
from .rivals.registry import named
from .rivals.rival import Case, Rival
from .setting import BASE_SAMPLES, OURS, SAMPLES, Setting, sweep

JUDGED = 0
"""The round in which images are judged. A bake that measures is not timed, a rival's run is."""

PROBES = 2048
"""Where a bake tells its own error, whatever that takes."""


@dataclass(frozen=True)
class Asked:
    """What to report on. `scene`, `view_layer` and `camera` are Blender's (None: the scene's own),
    `options_of` as `read_job` takes it, `is_untouched` and `runs_scripts` as `kept_scene` does;
    `has_parameters`: they are swept too, not only samples."""

    scene: Any
    view_layer: Any
    options_of: Callable[[Any], Options]
    frame: int
    camera: Any = None
    size: tuple[int, int] | None = None
    rivals: tuple[str, ...] = ()
    samples: tuple[int, ...] = SAMPLES
    repeats: int = 3
    has_parameters: bool = True
    is_untouched: bool = False
    runs_scripts: bool | None = None

    def told(self) -> dict[str, Any]:
        """What all runs have in common."""
        file, options = Path(bpy.data.filepath), self.options_of(self.scene)
        return {
            "strata": VERSION,
            "blender": bpy.app.version_string,
            "scene": f"{file.name or 'never saved'}, {self.scene.name}",
            "file": hashlib.sha256(file.read_bytes()).hexdigest()[:16] if file.is_file() else "",
            "view_layer": self.view_layer.name,
            "frame": self.frame,
            "camera": self.camera.name if self.camera else "",
            "size": list(self.size or ()),
            "backend": options.backend,
            "effects": list(options.effects or ()),
            "values": {effect: {name: str(value) for name, value in own.items()}
                       for effect, own in options.values.items()},
            "seed": options.seed,
            "lights": list(options.lights or ()),
            "rgb_layers": options.rgb_layers,
            "read": options.read,
            "read_texels": options.read_texels,
            "runs_scripts": self.runs_scripts,
        }  # fmt: skip


Show = Callable[[float, str, float | None], None]
"""show(share done, what is being done, seconds left if known); may raise to interrupt."""


class Sweep:
    """A report under way, in `folder`. `warnings`: what went otherwise than asked."""

    def __init__(self, asked: Asked, folder: Path, show: Show):
        self.asked, self.folder, self._show = asked, folder, show
        self.rivals = named(asked.rivals)
        self.told = asked.told()
        self.ledger = Ledger(folder, self.told)
        self.judge = Judge(folder, self.ledger.kept)
        self.warnings: list[str] = []
        self.settings: list[Setting] = []
        self.backend = ""
        self._spent: dict[str, list[float]] = {}
        self._todo: list[tuple[Setting, int]] = []
        self._doing, self._began = "Reading the scene", time.perf_counter()

    def run(self) -> None:
        """To its end. Raises what `show` raises, Cancelled and StrataError; what is found by then is kept."""
        job = self._job(None, BASE_SAMPLES, probes=1)
        self.backend = f"{job.devices.primary.name}: {job.devices.reason}"
        if self.judge.is_new:
            self.judge.look_at(job)
            self._run(job, "Finding the truth")
            self.judge.keep(job)
        if not self.judge.layers:
            return
        effects = {layer["effect"] for layer in self.judge.layers}
        is_traced = job.devices.primary.traces_rays
        chosen = {
            effect: params.settled(is_traced)
            for effect, params in job.options.chosen().items()
            if effect.id in effects
        }
        asked = self.asked
        self.settings += sweep(chosen if asked.has_parameters else {}, asked.samples)
        where = asked.scene, asked.view_layer, asked.camera and asked.camera.name
        with kept_scene(*where, asked.is_untouched, asked.runs_scripts) as kept:
            case, running = self._case(job, kept), {}
            for rival in self.rivals:
                if reason := (rival.why_not() if case else "no lamp's shadow is measured in a way it can be"):
                    self.warnings.append(f"{rival.title} is not here: {reason}")
                    continue
                try:
                    self.settings += rival.settings(case)
                    running[rival.id] = rival
                except StrataError as error:
                    self.warnings.append(f"{rival.title} is not here: {one_line(error)}")
            rounds = range(asked.repeats + 1)
            self._todo = [
                (setting, number)
                for number in rounds
                for setting in self.settings
                if not self.ledger.has(setting.key, number)
                and (setting.who == OURS or number < max(asked.repeats, 1))
            ]
            while self._todo:
                setting, number = self._todo[0]
                self._add(setting, number, case, running.get(setting.who))
                del self._todo[0]

    def _job(self, setting: Setting | None, samples: int, probes: int | None) -> BakeJob:
        asked = self.asked

        def options_of(scene: Any) -> Options:
            options = asked.options_of(scene)
            values = {effect: dict(own) for effect, own in options.values.items()}
            for effect, own in (setting.nested() if setting else {}).items():
                values[effect] = values.get(effect, {}) | own
            plain = {"target_error": 0.0, "time_budget_s": 0.0, "error_images": False, "composite": False}
            plain["own_targets"] = {}
            return replace(options, samples=samples, probes=probes, values=values, **plain)

        return read_job(asked.scene, asked.view_layer, options_of, asked.frame, asked.camera, asked.size)

    def _run(self, job: BakeJob, doing: str) -> Baked:
        def show(share: float, stage: str, seconds_left: float | None) -> None:
            self._look()

        self._doing = doing
        return run_to_end(job, show=show)

    def _look(self) -> None:
        """Tells how far it is."""
        done = sum(map(sum, self._spent.values()))
        now = time.perf_counter() - self._began
        left = sum(self._expected(setting) for setting, _ in self._todo)
        is_known = bool(self._spent)
        share = (done + now) / max(done + now + max(left - now, 0.0), 1e-9) if is_known else 0.0
        self._show(share, self._doing, max(left - now, 0.0) if is_known else None)

    def _expected(self, setting: Setting) -> float:
        """Seconds of a run: what it took before, or one of the same curve by its samples, or any."""
        if setting.key in self._spent:
            return self._spent[setting.key][-1]
        known = {each.key: each for each in self.settings if each.key in self._spent}
        near = [each for each in known.values() if each.who == setting.who] or list(known.values())
        each = min(near, key=lambda each: abs(np.log(each.samples / setting.samples)), default=None)
        if each is None:
            return 0.0
        return self._spent[each.key][-1] * max(setting.samples / each.samples, 0.5)

    def _add(self, setting: Setting, number: int, case: Case | None, rival: Rival | None) -> None:
        """One run; what fails is told, and costs no other."""
        self._doing, self._began = setting.key, time.perf_counter()
        self._look()
        run: dict[str, Any] = {"key": setting.key, "round": number}
        try:
            if rival:
                run |= self._rivals_run(rival, case, setting, number)
            else:
                run |= self._own_run(setting, number)
        except (StrataError, KeyError, ValueError, OSError) as error:
            if rival is None and not isinstance(error, StrataError):
                raise  # a fault of ours
            run["failed"] = one_line(error)
            self.warnings.append(f"{setting.key}: {one_line(error)}")
        self._spent.setdefault(setting.key, []).append(time.perf_counter() - self._began)
        self.ledger.add(run)

    def _own_run(self, setting: Setting, number: int) -> dict[str, Any]:
        if number == JUDGED:
            job, layers = self._job(setting, setting.samples, PROBES), {}
            for layer in self._run(job, setting.key).layers.layers:
                pixels = job.graph.shot.source.computed(layer.pixels)
                found = self.judge.judged(setting, layer.name, {"": pixels})
                reported = {key: item for key, item in layer.error.items() if key != "reference"}
                layers[layer.name] = {**found, "reported": reported}
            return {"layers": layers}
        with counted() as cost:
            self._run(self._job(setting, setting.samples, 0), setting.key)
        return {"cost": cost.to_json()}

    def _rivals_run(self, rival: Rival, case: Case, setting: Setting, number: int) -> dict[str, Any]:
        found = rival.run(case, setting, number == JUDGED, self._look)
        layers = {name: self.judge.judged(setting, name, images) for name, images in found.images.items()}
        return {"cost": found.cost.to_json()} | ({"layers": layers} if layers else {})

    def _case(self, job: BakeJob, kept: Scene) -> Case | None:
        """What rivals are told; None where there is nothing for them to make."""
        outline, shot = job.outline, job.graph.shot
        shown, lamps = Counter(light.lamp for light in outline.lights), {}
        known = {layer["name"] for layer in self.judge.layers}
        for layer in job.graph.layers:
            if layer.name not in self.judge.truths or layer.name not in known or not layer.of.is_lamp:
                continue
            light = outline.lights[layer.of.index]
            if layer.role is Role.VISIBILITY and light.lamp == light.key and shown[light.lamp] == 1:
                lamps[layer.name] = light.lamp
        if not lamps or not self.rivals:
            return None
        try:
            request = request_of(kept, outline, job.graph, Grid(1, (0, 0), shot.computed_size))
        except StrataError as error:
            self.warnings.append(f"no rival is here: {one_line(error)}")
            return None
        in_colour = {layer.name for layer in job.graph.layers if len(layer.channels) > 1}
        luminance = np.array(luminance_of(outline.working_space))
        return Case(
            kept,
            request,
            lamps,
            frozenset(in_colour),
            luminance,
            self.ledger.kept,
            lambda setting: self._job(setting, setting.samples, 0),
        )
