"""What cannot matter changes nothing: a million hidden triangles and a dozen lights without power."""

from strata.scripts.bench import idle


def test_useless_objects_and_dark_lights_change_no_bit_and_are_left_out():
    found = idle.run("animated", size=(160, 90), repeats=1)
    assert found.same
    assert found.left_out
