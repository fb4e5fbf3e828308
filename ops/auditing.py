"""A bake of the command line held against Cycles."""

from __future__ import annotations

from ..addon.core.errors import StrataError
from .terminal import Interrupts, Progress


def held_against_cycles(baked, job, arguments, scene, view_layer, interrupts: Interrupts, progress: Progress):
    """The same bake, held against Cycles."""
    from ..addon.audit.audit import audited, not_audited
    from ..addon.audit.other_blender import kept_scene

    def show(share: float) -> None:
        interrupts.check()
        progress.show(share, "Auditing", None)

    is_untouched = bool(arguments.scene_file)
    scripts = arguments.trust_scripts or (False if is_untouched else None)
    try:
        kept = kept_scene(scene, view_layer, arguments.camera, is_untouched, scripts)
    except StrataError as error:
        return not_audited(baked, error)
    with kept:
        return audited(baked, kept, job.outline, job.graph, show=show)
