"""Write a body with handles and true poses, for a first deformation; needs no library of the benchmark."""

from __future__ import annotations

from pathlib import Path

from defaust.build.handles import choose_handles, handle_records
from defaust.build.options import BuildOptions
from defaust.folder.layout import REST, dump, make_folder, pose_file, write_text
from defaust.sources.skinning import apply_motions
from defaust.sources.synthetic import SyntheticBodies
from defaust.tasks.loop import loop_matrix, split
from sshade import Mesh
from sshade.files.meshes import write_mesh

SUBJECT = 0
#: Poses by their numbers in the dataset: raised arms, raised forearms, standing on one leg.
POSES = (1, 6, 8)


def write_example(folder: Path, *, subdivisions: int = 2) -> Mesh:
    """Write the rest mesh, and the handles and the true vertices of each pose.

    Parameters
    ----------
    folder : path
        Made if it does not exist. Files of the same names are replaced.
    subdivisions : int
        Number of Loop subdivisions of the body of 6,890 vertices. Each makes four triangles of one.

    Returns
    -------
    Mesh
        Rest mesh, in metres.

    Raises
    ------
    InputError
        When the files cannot be written.
    """
    source, options = SyntheticBodies(), BuildOptions()
    low = fine = source.rest(SUBJECT)
    for _ in range(subdivisions):
        fine = split(fine)
    loop = loop_matrix(low, fine, steps=subdivisions)
    rest = Mesh(loop @ low.V, fine.F)
    # Subdivision keeps the numbers of the vertices.
    chosen = choose_handles(low, source.landmark_vertices(SUBJECT), subject=SUBJECT, options=options)
    make_folder(folder)
    write_mesh(folder / REST, rest.V, rest.F)
    for number in POSES:
        pose = source.poses(SUBJECT)[number - 1]
        motions, shift = source.motions(SUBJECT, pose.name)
        truth = Mesh(apply_motions(loop @ motions, rest.V) + shift, rest.F)
        records = handle_records(rest, truth, pose, regions=(), chosen=chosen, options=options)
        text = dump({"source_pose": pose.name, "handles": records}, indent=None)
        write_text(folder / pose_file(number), text)
        write_mesh(folder / f"pose_{number}_true.ply", truth.V, truth.F)
    return rest
