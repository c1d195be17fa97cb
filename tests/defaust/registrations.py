"""Folders with the layout of FAUST, filled with synthetic bodies, which have FAUST's counts."""

from functools import partial
from pathlib import Path

from defaust.build.options import BuildOptions
from defaust.configuration import configure
from defaust.sources.synthetic import SyntheticBodies
from sshade.files.meshes import write_mesh

#: FAUST's numbers of a rest pose and the four default target poses.
POSES = (0, 1, 3, 6, 8)
#: The bodies in the files. Some landmark of FAUST moves in each target pose.
BODIES = SyntheticBodies(poses_used=("sitting", "leg_lift", "squat", "bend_twist"))
SMALL = BuildOptions(target_vertices=3000, window=(0.7, 1.5), remesh_iterations=2)


def write_faust(folder: Path, *, subjects=(0,), poses=POSES, suffix=".ply") -> Path:
    """Write tr_reg_NNN files of some subjects to a new folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for subject in subjects:
        meshes = [BODIES.rest(subject), *(BODIES.posed(subject, pose) for pose in BODIES.poses(subject))]
        for pose, mesh in zip(POSES, meshes, strict=True):
            if pose in poses:
                write_mesh(folder / f"tr_reg_{10 * subject + pose:03d}{suffix}", mesh.V, mesh.F)
    return folder


def configured(name: str, root: Path, *overrides: str):
    """The source that the command line makes."""
    return configure(["out=unused", f"source={name}", f"source.root='{root}'", *overrides]).source


#: FAUST. The bodies have other shapes at FAUST's landmarks.
faust = partial(configured, "faust")
