"""Iterations of six scenes, which no change may raise by a tenth; `make test` lists them."""

import pytest

import fabric_fenicsx as ff


def press(name, **blank):
    return ff.Press.read(name, [f"blank.{key}={value}" for key, value in blank.items()])


SCENES = {
    "tensile": (ff.Tensile, {}, 23),
    "bias_extension, P1": (lambda: ff.BiasExtension(nx=16, element="P1"), {}, 61),
    "picture_frame": (ff.PictureFrame, {}, 166),
    "double_dome": (lambda: press("double_dome", nx=12), {"steps": 10}, 129),
    "double_dome, +-45": (lambda: press("double_dome", nx=12, fibre_angle=45), {"steps": 10}, 287),
    "hemisphere": (lambda: press("hemisphere"), {"steps": 10}, 187),
}


@pytest.mark.parametrize("name", SCENES)
def test_iterations_do_not_rise(name, record_property):
    scene, options, known = SCENES[name]
    iterations = scene().job(balance=None, **options).run().summary["newton_iterations"]
    record_property("iterations", f"{name} {iterations}")
    assert iterations <= 1.1 * known
