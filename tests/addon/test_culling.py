# SPDX-License-Identifier: GPL-3.0-or-later
"""What no ray reaches is not modelled, and its absence cannot be seen."""

import dataclasses

import numpy as np
import pytest
import scenes

from addon import model, pipeline
from addon.plan import culling

SUN = model.Light("sun", (3.0, 3.0, 3.0), name="Sun", direction=(0.0, 0.0, 1.0))
POINT = model.Light("point", (40.0, 40.0, 40.0), name="Point", position=(3.0, -3.0, 5.0))


def dark(*places, lights=(SUN,), **more):
    """Small spheres at the places, in a world without light of its own."""
    instances = [scenes.place(at=at, scale=0.4) for at in places]
    made = scenes.scene([scenes.sphere(n=8)], instances, lights=lights, **more)
    return dataclasses.replace(made, world=model.World())


def reached(scene):
    return culling.reached(scene, list(scene.instances)).tolist()


def test_what_is_behind_the_camera_and_off_the_paths_of_light_is_left_out():
    scene = dark((0, 0, 0), (0, -20, 0), (50, 0, 0), (0, 0, 30), (0, 0, -30))
    assert reached(scene) == [True, False, False, True, False]  # the fourth shades the first


def test_a_point_light_is_shaded_only_from_between():
    between, beyond = np.array(POINT.position) / 2, 3 * np.array(POINT.position)
    scene = dark((0, 0, 0), between, beyond, lights=(POINT,), view=scenes.camera(fov=0.2))
    assert reached(scene) == [True, True, False]


def test_a_light_without_shadow_and_an_object_without_one_do_not_count():
    scene = dark((0, 0, 0), (0, 0, 30), lights=(dataclasses.replace(SUN, casts_shadow=False),))
    assert reached(scene) == [True, False]
    scene = dark((0, 0, 0), (0, 0, 30))
    clear = dataclasses.replace(scene.instances[1], visible_shadow=False)
    assert culling.reached(scene, [scene.instances[0], clear]).tolist() == [True, False]


def test_light_from_all_around_reaches_everything():
    scene = dataclasses.replace(dark((0, 0, 0), (0, -20, 0)), world=model.World((0.0, 0.1, 0.0)))
    assert reached(scene) == [True, True]


@pytest.mark.parametrize("kind", ["glossy", "glass", "principled"])
def test_what_is_seen_in_a_mirror_is_not_left_out(kind):
    scene = dark((0, 0, 0), (0, -20, 0))
    assert reached(scene) == [True, False]
    bright = tuple(
        dataclasses.replace(material, lobes=(model.Lobe(kind),)) for material in scene.materials
    )
    assert reached(dataclasses.replace(scene, materials=bright)) == [True, True]


def test_lights_with_extent_are_shaded_from_beside_too():
    above, beside = (0, 0, 30), (4, 0, 30)
    for angle, found in ((0.0, False), (0.1, False), (0.3, True), (3.1, True)):
        sun = dataclasses.replace(SUN, angle=angle)
        assert reached(dark((0, 0, 0), above, beside, lights=(sun,)))[1:] == [True, found]
    narrow = scenes.camera(fov=0.2)
    for radius, found in ((0.0, False), (3.0, True)):
        point = dataclasses.replace(POINT, radius=radius)
        scene = dark((0, 0, 0), (3, -5.5, 4.5), lights=(point,), view=narrow)
        assert reached(scene) == [True, found]


def test_mirrors_reach_everything():
    scene = dark((0, 0, 0), (0, -20, 0))
    mirror = model.Material("Mirror", (model.Lobe("glossy"),))
    assert reached(scene) == [True, False]
    assert reached(dataclasses.replace(scene, materials=(mirror,))) == [True, True]


def test_diffuse_bounces_and_ambient_occlusion_reach_everything():
    places = (0, 0, 0), (0, -20, 0)
    assert reached(dark(*places)) == [True, False]
    assert reached(dark(*places, diffuse_bounces=1)) == [True, True]
    ambient = dataclasses.replace(dark(*places), passes=("Combined", "Ambient Occlusion"))
    assert reached(ambient) == [True, True]


def test_an_emitting_object_behind_the_camera_lights_what_is_seen():
    scene = dark((0, 0, 0), (0, -20, 0), diffuse_bounces=1, samples=16)
    ball, emitter = scene.instances[0], scenes.place(at=(0, -20, 0), scale=4.0, materials=(2,))
    emission = model.Material("Emitter", (model.Lobe("emission", (50.0, 50.0, 50.0)),))
    materials = *scene.materials, emission
    scene = dataclasses.replace(scene, materials=materials, instances=(ball, emitter), lights=())
    alone = dataclasses.replace(scene, instances=(ball,))
    lit, unlit = (pipeline.render(s).passes["Combined"][..., :3].max() for s in (scene, alone))
    assert unlit == 0 and lit > 0.1


def test_clipping_counts():
    view = dataclasses.replace(scenes.camera(), clip_start=5.0, clip_end=7.0)
    assert reached(dark((0, 0, 0), (0, 5, 0), (0, -3, 0), view=view)) == [True, False, False]


def test_thousands_of_instances_are_judged_together():
    rng = np.random.default_rng(5)
    places = rng.uniform(-40, 40, (5000, 3))
    scene = dark(*places)
    got = np.array(reached(scene))
    view = scenes.camera()
    depth = (places - view.eye) @ view.forward
    x = (places - view.eye) @ view.dx / (view.dx @ view.dx) / depth
    y = (places - view.eye) @ view.dy / (view.dy @ view.dy) / depth
    centres_seen = (depth > 0.1) & (abs(x) < scene.width / 2) & (abs(y) < scene.height / 2)
    assert centres_seen.sum() > 50
    assert got[centres_seen].all()
    assert 0.02 < got.mean() < 0.9


@pytest.mark.parametrize("lights", [(SUN,), (POINT,), (SUN, POINT)])
@pytest.mark.parametrize("scale", [None, 4.0])
def test_pictures_do_not_depend_on_what_is_left_out(monkeypatch, lights, scale):
    rng = np.random.default_rng(7)
    places = [(0, 0, 0), *rng.uniform(-6, 6, (60, 3))]
    scene = dark(*places, lights=lights, view=scenes.camera(scale=scale), resolution=16)
    some = pipeline.render(scene)
    met = culling.reached(scene, list(scene.instances))
    assert not met.all()
    monkeypatch.setattr(culling, "reached", lambda s, instances: np.ones(len(instances), bool))
    every = pipeline.render(scene)
    for name, image in every.passes.items():
        np.testing.assert_array_equal(some.passes[name], image, err_msg=name)


def test_a_scene_of_which_nothing_can_be_seen_is_empty_and_no_error():
    frame = pipeline.render(dark((0, -20, 0)))
    assert not frame.passes["Combined"][..., :3].any()
    assert frame.report["volumes"] == []


def test_what_volumes_scatter_reaches_everything():
    scene = dark((0, 0, 0), (0, -20, 0))
    assert reached(scene) == [True, False]
    look = model.Look(model.nothing, model.nothing)
    field = model.Field("fog", None, "", (), look=look)
    assert reached(dataclasses.replace(scene, fields=(field,))) == [True, True]
    solid = dataclasses.replace(field, look=None)
    assert reached(dataclasses.replace(scene, fields=(solid,))) == [True, False]
