"""The tool that baked the synthetic bodies. Its source files are not in the repository."""

import gzip

import numpy as np

from defaust.sources.noisy import bone_rotations, pose_names
from defaust.sources.source import read_asset
from defaust.sources.synthetic import SHA256, load_bodies
from tools.bake import noisy
from tools.bake.__main__ import add_poses, without_reaches
from tools.bake.morphs import AGES, BONES, BaseMesh, Shape, morph, read_base


def write_target(folder, name, rows):
    path = folder / "targets" / "macrodetails" / f"{name}.target.gz"
    path.parent.mkdir(parents=True, exist_ok=True)
    with gzip.open(path, "wt") as file:
        file.write("# comment\n" + "".join(f"{' '.join(map(str, row))}\n" for row in rows))


def test_macro_weights_are_products(tmp_path):
    shape = Shape(gender=1.0, age=0.75, muscle=0.5, weight=0.75, height=0.75, race=(1.0, 0.0, 0.0))
    for age in ("young", "old"):
        write_target(tmp_path, f"african-male-{age}", [(0, 10, 0, 0)])
        for weight, x in (("average", 10), ("max", 30)):
            write_target(tmp_path, f"universal-male-{age}-averagemuscle-{weight}weight", [(1, 0, x, 0)])
            name = f"height/male-{age}-averagemuscle-{weight}weight-maxheight"
            write_target(tmp_path, name, [(1, 0, 0, 10)] if weight == "max" else [])
    base = BaseMesh(np.zeros((2, 3)), np.zeros((0, 3), dtype=int), {})
    V = morph(tmp_path, base, shape=shape)
    # Decimetres to metres; half of each weight target; height .75 is half way to the maximum,
    # and its target moves the vertex for one of the two weights only.
    np.testing.assert_allclose(V, [[1.0, 0, 0], [0, 2.0, 0.25]], atol=1e-15)
    assert AGES["young"] == 0.5


def test_base_mesh_is_split_along_the_shorter_diagonal(tmp_path):
    (tmp_path / "3dobjs").mkdir()
    (tmp_path / "3dobjs/base.obj").write_text(
        "# c\nv 0 0 0\nv 10 0 0\nv 30 10 0\nv 0 10 0\nv 5 5 5\ng body\nf 1/1 2/2 3/3 4/4\n"
        "g helper\nf 1/1 2/2 5/5 4/4\n"
    )
    base = read_base(tmp_path)
    assert base.F.tolist() == [[0, 1, 3], [1, 2, 3]]
    np.testing.assert_array_equal(base.V[1], [1.0, 0, 0])
    assert base.groups["helper"].tolist() == [0, 1, 3, 4]


def test_the_shipped_poses_can_be_baked_again_from_the_shipped_bodies():
    arrays = read_asset("bodies", sha256=SHA256)
    first = arrays | {name: arrays[name][:1] for name in ("offset", "joints", "rotations", "shifts")}
    kept = without_reaches(first)
    assert kept["rotations"].shape == (1, 4, len(BONES), 3) and kept["shifts"].shape == (1, 4, 3)
    again = add_poses(kept)
    assert again.keys() == arrays.keys()
    np.testing.assert_array_equal(again["pose_names"], arrays["pose_names"])
    for name in ("rotations", "shifts"):
        np.testing.assert_array_equal(again[name][:, :4], first[name][:, :4])
        np.testing.assert_allclose(again[name], first[name], atol=1e-4)


def test_a_pose_of_the_noisy_bodies_can_be_baked_again():
    name = pose_names(5)[0]
    rotations, shift = noisy.make_pose(
        load_bodies(), subject=5, pose=noisy.POSES["held_out"][name], seed=[noisy.SEED, 5, 0]
    )
    for found, shipped in zip((rotations, shift), bone_rotations(5, name), strict=True):
        np.testing.assert_allclose(found, shipped, atol=1e-3)
    assert [list(poses) for poses in noisy.POSES.values()] == [pose_names(0), pose_names(9)]
