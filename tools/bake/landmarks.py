"""Find named vertices of the template: ray hits from the joints, and extremal vertices."""

from __future__ import annotations

import igl
import numpy as np

X, Y, Z = np.eye(3)


def find_landmarks(
    V: np.ndarray, F: np.ndarray, *, heads: dict[str, np.ndarray], tails: dict[str, np.ndarray]
) -> dict[str, int]:
    """Find the vertex of each landmark.

    Parameters
    ----------
    V : (n, 3) float64
        Neutral body, y up, facing +z, its left at +x.
    F : (m, 3) int64
    heads, tails : bone name -> (3,) float64
        Both ends of the bones of the neutral body, the fingers included.
    """

    def hit(origin: np.ndarray, direction: np.ndarray) -> int:
        hits = igl.ray_mesh_intersect(origin, direction, V, F)
        corners = F[hits[0][0]]
        point = origin + hits[0][1] * direction
        return int(corners[np.argmin(np.linalg.norm(V[corners] - point, axis=1))])

    def extremal(direction: np.ndarray, mask: np.ndarray) -> int:
        return int(np.argmax(np.where(mask, V @ direction, -np.inf)))

    found = {}
    height = V[:, 1] - V[:, 1].min()
    for side, outward in (("l", X), ("r", -X)):
        head = {name[:-2]: p for name, p in heads.items() if name.endswith(f"_{side}")}
        tail = {name[:-2]: p for name, p in tails.items() if name.endswith(f"_{side}")}
        back = np.cross(head["middle_01"] - head["hand"], head["index_01"] - head["pinky_01"])
        back *= np.sign(back @ (outward + Y)) / np.linalg.norm(back)
        finger = tail["middle_03"] - head["middle_01"]
        tip = np.linalg.norm(V - tail["middle_03"], axis=1) < 0.02
        foot = (V @ outward > 0) & (height < 0.1 * height.max())
        found |= {
            f"hand_{side}": hit(0.5 * (head["hand"] + head["middle_01"]), back),
            f"wrist_{side}": hit(head["hand"], back),
            f"fingertip_{side}": extremal(finger, tip),
            f"elbow_{side}": hit(head["lowerarm"], -Z),
            f"shoulder_{side}": hit(head["upperarm"], Y),
            f"hip_{side}": hit(head["thigh"], outward),
            f"knee_{side}": hit(head["calf"], Z),
            f"ankle_{side}": hit(head["foot"], Z),
            f"foot_{side}": hit(head["ball"], Y),
            f"heel_{side}": extremal(-Z, foot),
            f"toe_{side}": extremal(Z, foot),
        }
    skull = 0.5 * (heads["head"] + tails["head"])
    return found | {
        "head_top": extremal(Y, height > 0),
        "nose": extremal(Z, V[:, 1] > heads["head"][1]),
        "head_back": hit(skull, -Z),
        "neck_back": hit(heads["neck_01"], -Z),
        "chest": hit(heads["spine_03"], Z),
        "upper_back": hit(heads["spine_03"], -Z),
        "belly": hit(heads["spine_01"], Z),
        "pelvis_front": hit(heads["pelvis"], Z),
        "pelvis_back": hit(heads["pelvis"], -Z),
    }
