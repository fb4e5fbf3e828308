"""The choice of probes against a plain choice from the whole image, and strata against brute force."""

import numpy as np
import pytest
import strata_kernels
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.random import hash_bits, text_bits
from strata.addon.core.slices import finished
from strata.addon.core.surface import Chunk, SurfacePoints
from strata.addon.devices.cpu import CpuRays
from strata.addon.effects.shared.visibility_truth import unshadowed
from strata.addon.measure.difficulty import Difficulty, Ground, classify, near_changes, reach
from strata.addon.measure.probes import ProbeCollector
from strata.addon.measure.shadow_probes import PIXELS_PER_PROBE, WatchedShadow, shadow_strata

WIDTH, HEIGHT = 61, 47
AXES = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)
LAMP = Emitter(EmitterKind.RECTANGLE, (0.0, 0.0, 3.0), *AXES, 0.3, 0.3)


def watched_shadow(effect="soft_shadow", receivers=None):
    return WatchedShadow("Shadow", effect, LAMP, np.zeros(3), receivers)


def scene():
    """A floor below the eye under a wall, and a round shadow on it with a soft edge."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    position = np.stack([x / 20.0 - 1.5, y / 20.0 - 1.0, np.full_like(x, -2.0)], -1)
    normal = np.zeros_like(position)
    normal[..., 2] = 1.0
    wall = y > 40
    position[wall] = np.stack([x / 20.0 - 1.5, np.full_like(x, 5.0), y / 20.0 - 3.0], -1)[wall]
    normal[wall] = (0.0, -1.0, 0.0)
    position[:, :3], normal[:, :3] = 0.0, 0.0  # nothing there
    surface = {"position": position, "geometric_normal": normal, "shading_normal": normal.copy()}
    surface["instance"] = np.where(x > 50, 7, 3).astype(np.int32)
    values = np.clip((np.hypot(x - 30, y - 20) - 8.0) / 6.0, 0.0, 1.0).astype(np.float32)
    return surface, values


def collected(tiles, watched=None, probes=4, seed=3, frame=1, spoil=None):
    surface, values = scene()
    if spoil:
        spoil(surface, values)
    watched = watched or [watched_shadow()]
    collector = ProbeCollector(watched, probes, seed, frame)
    y0 = 0
    for rows in tiles:
        y1 = y0 + rows
        tile = {name: array[y0:y1] for name, array in surface.items()}
        layers = {layer.name: values[y0:y1] for layer in watched}
        finished(collector.add(Chunk(WIDTH, HEIGHT, y0, y1, 0, (0.0, 0.0)), tile, layers))
        y0 = y1
    return shadow_strata(collector.strata(watched[0].name), watched[0].eye)


def codes():
    surface, values = scene()
    return classify(Ground(surface), values, LAMP, np.zeros(3))


@pytest.mark.parametrize("probes", [1, 4, 1000])
def test_every_stratum_keeps_its_smallest_priorities(probes):
    strata = collected([HEIGHT], probes=probes)
    surface, values = scene()
    code = codes()
    priority = hash_bits(3, text_bits("soft_shadow"), 1, np.arange(WIDTH * HEIGHT))
    present = np.unique(code[code != Difficulty.DARK]).tolist()
    assert {Difficulty.PENUMBRA, Difficulty.EDGE, Difficulty.REST} <= {each & 7 for each in present}
    for each, stratum in zip(present, strata, strict=True):
        members = np.flatnonzero(code == each)
        expected = np.sort(members[np.argsort(priority[members])][: PIXELS_PER_PROBE[each & 7] * probes])
        assert stratum.difficulty == each & 7
        assert stratum.population == len(members)
        assert stratum.pixels.tolist() == expected.tolist()
        assert (stratum.priorities == priority[expected]).all()
        assert (stratum.values == values.reshape(-1)[expected]).all()
        for name in ("position", "geometric_normal", "shading_normal"):
            assert (getattr(stratum.points, name) == surface[name].reshape(-1, 3)[expected]).all()


@pytest.mark.parametrize("tiles", [[1] * HEIGHT, [5] * 9 + [2], [46, 1], [1, 46], [2, 3, 20, 1, 21]])
@pytest.mark.parametrize("probes", [2, 1000])
def test_the_choice_does_not_depend_on_tiles(tiles, probes):
    whole, tiled = collected([HEIGHT], probes=probes), collected(tiles, probes=probes)
    for one, other in zip(whole, tiled, strict=True):
        assert one.difficulty == other.difficulty
        assert one.population == other.population
        assert (one.pixels == other.pixels).all()
        assert (one.points.position == other.points.position).all()


def test_a_part_of_a_choice_is_the_choice_of_fewer_probes():
    many, few = collected([HEIGHT], probes=3), collected([HEIGHT], probes=1)
    for large, small in zip(many, few, strict=True):
        part = large.at(large.smallest(PIXELS_PER_PROBE[large.difficulty]))
        assert part.pixels.tolist() == small.pixels.tolist()
        assert large.smallest(10**6).tolist() == list(range(len(large.pixels)))


def test_seed_frame_and_effect_change_the_choice():
    def pixels(**changes):
        strata = collected([HEIGHT], probes=1, **changes)
        return [pixel for stratum in strata for pixel in stratum.pixels.tolist()]

    other_effect = [watched_shadow(effect="toon")]
    choices = [pixels(), pixels(seed=4), pixels(frame=2), pixels(frame=-1), pixels(watched=other_effect)]
    assert len({tuple(choice) for choice in choices}) == 5
    assert pixels() == choices[0]


def test_later_samples_are_passed_over_and_gaps_refused():
    surface, values = scene()
    collector = ProbeCollector([watched_shadow()], 4, 0, 1)
    finished(collector.add(Chunk(WIDTH, HEIGHT, 0, HEIGHT, 1, (0.2, 0.1)), surface, {"Shadow": values}))
    assert list(collector.strata("Shadow")) == []
    with pytest.raises(ValueError, match="row 5 came before that at row 0"):
        finished(collector.add(Chunk(WIDTH, HEIGHT, 5, HEIGHT, 0, (0.0, 0.0)), surface, {"Shadow": values}))


def test_what_the_light_does_not_light_is_left_alone():
    lit = collected([20, HEIGHT - 20], [watched_shadow(receivers=frozenset({7}))])
    assert lit
    assert all((stratum.pixels % WIDTH > 50).all() for stratum in lit)


def test_a_value_that_is_not_a_number_counts_as_black():
    def spoil(surface, values):
        values[5, 10], values[5, 11], values[5, 12] = np.nan, np.inf, -np.inf

    strata = collected([HEIGHT], probes=1000, spoil=spoil)
    found = {int(p): v for stratum in strata for p, v in zip(stratum.pixels, stratum.values, strict=True)}
    assert [found[5 * WIDTH + x] for x in (10, 11, 12)] == [0.0, 0.0, 0.0]
    assert found[5 * WIDTH + 13] == 1.0


def test_near_changes_against_brute_force():
    rng = np.random.default_rng(0)
    change_x, change_y = rng.random((9, 11)) < 0.03, rng.random((8, 12)) < 0.03
    near = near_changes(change_x, change_y)
    assert near.shape == (9, 12)
    beside = {(y, x + side) for y, x in zip(*np.nonzero(change_x), strict=True) for side in (0, 1)}
    beside |= {(y + side, x) for y, x in zip(*np.nonzero(change_y), strict=True) for side in (0, 1)}
    for y, x in np.ndindex(near.shape):
        expected = any(abs(y - b) + abs(x - a) <= 1 for b, a in beside)
        widened = any(max(abs(y - b), abs(x - a)) <= 2 for b, a in beside)
        assert near[y, x] >= expected
        assert widened >= near[y, x]  # never farther than the margin that tiles keep


def test_strata_of_the_scene():
    surface, values = scene()
    code = codes().reshape(HEIGHT, WIDTH) & 7
    partly = (values > 0) & (values < 1)
    assert (code[:, :3] == Difficulty.DARK).all()
    assert (code[:, 3:] != Difficulty.DARK).all()
    assert ((code == Difficulty.PENUMBRA) == (partly & (surface["position"][..., 2] != 0))).all()
    assert code[20, 30] == code[2, 50] == Difficulty.REST
    assert code[20, 30 + 15] == code[20, 30 + 7] == Difficulty.EDGE  # just beyond either end of the penumbra
    assert (code[40, 5:15] == Difficulty.EDGE).all()  # below the wall


EMITTERS = {
    "rectangle": LAMP,
    "ellipse": Emitter(EmitterKind.ELLIPSE, (0.0, 0.0, 1.0), *AXES, 0.5, 0.2),
    "sphere": Emitter(EmitterKind.SPHERE, (0.3, 0.0, 1.0), *AXES, 0.4, 0.4),
    "point": Emitter(EmitterKind.SPHERE, (0.3, 0.0, 1.0), *AXES, 0.0, 0.0),
    "spot": Emitter(EmitterKind.SPHERE, (0.0, 0.0, 1.0), *AXES, 0.3, 0.3, cos_cone=0.8, blend=0.2),
    "wide spot": Emitter(EmitterKind.FACING_DISK, (0.0, 0.0, 1.0), *AXES, 0.3, 0.3, cos_cone=-0.1, blend=0.5),
    "facing disk": Emitter(EmitterKind.FACING_DISK, (0.0, 0.2, 1.0), *AXES, 0.4, 0.4),
    "sun": Emitter(EmitterKind.DISTANT_DISK, (0.0, 0.0, 0.0), *AXES, 0.1, 0.1),
}


@pytest.mark.parametrize("emitter", EMITTERS.values(), ids=EMITTERS)
def test_only_what_gets_no_light_is_dark(emitter):
    rng = np.random.default_rng(1)
    count = 20_000
    position = rng.uniform(-2, 2, (count, 3)).astype(np.float32)
    normal = rng.normal(size=(count, 3))
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    eye = np.array([0.5, -0.25, 0.125])
    surface = {"position": position, "geometric_normal": normal, "shading_normal": normal}
    dark, _, brightness = reach(Ground({name: array[None] for name, array in surface.items()}), emitter, eye)
    rays = CpuRays(strata_kernels.Accel(strata_kernels.Geometry(), eye), eye)
    weights = unshadowed(rays, emitter, SurfacePoints(position, normal, normal, eye))
    assert (weights[dark] == 0.0).all()
    # And most of what is dark is known to be.
    assert dark.sum() > 0.8 * (weights == 0.0).sum() > 0
    # The brightness is a guess, but it sorts: within a step of a factor of 4, weights are much alike.
    assert (brightness > 0.0).all()
    lit = weights > 0.0
    steps = np.log(brightness[lit]) // np.log(4.0)
    for step in np.unique(steps):
        alike = weights[lit][steps == step].astype(np.float64)
        assert len(alike) < 200 or (alike**2).mean() < 4.0 * alike.mean() ** 2
