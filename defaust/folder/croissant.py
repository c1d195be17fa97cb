"""The file croissant.json of a DeFAUST folder: its files, cases and handles in the Croissant 1.0 format.

Croissant is the vocabulary, after schema.org, that dataset hubs read. The file follows from dataset.json
alone and describes dataset.json too, which therefore neither lists it nor includes it in the checksum.
"""

from __future__ import annotations

import hashlib
from typing import Any

from defaust.folder.layout import CARD, DATASET, REST, REST_LOW, pose_file, pose_mesh, subject_folder
from defaust.folder.record import has_regions
from sshade.core.errors import counted

SCHEMA = "https://schema.org/"
#: Terms of the format, which every Croissant file repeats; field names follow mlcommons.org/croissant/1.0.
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": SCHEMA,
    "sc": SCHEMA,
    "cr": "http://mlcommons.org/croissant/",
    "dct": "http://purl.org/dc/terms/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "conformsTo": "dct:conformsTo",
    **{
        name: f"cr:{name}"
        for name in (
            "citeAs", "column", "equivalentProperty", "extract", "field", "fileProperty", "fileObject",
            "fileSet", "format", "includes", "isLiveDataset", "jsonPath", "key", "md5", "parentField", "path",
            "recordSet", "references", "regex", "repeated", "replace", "samplingRate", "separator", "source",
            "subField", "transform",
        )
    },
    **{name: {"@id": f"cr:{name}", "@type": "@json"} for name in ("data", "examples")},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
}  # fmt: skip
#: Type of a file by the ending of its name.
ENCODINGS = {".json": "application/json", ".md": "text/markdown", ".ply": "model/ply"}
#: Set of the files with the handles of one pose each.
POSES = "poses"


def croissant(document: dict[str, Any], *, text: str) -> dict[str, Any]:
    """Describe a dataset in the Croissant format.

    Parameters
    ----------
    document : dict
        Content of dataset.json.
    text : str
        The text of dataset.json, for its sha256.

    Returns
    -------
    dict
        Content of croissant.json. The record set ``cases`` has one record for each subject and pose, and
        ``handles`` one for each pose and landmark: its kind (static, dynamic or unused) with its positions at
        rest and in the pose, or with the boxes and the motion of its region.
    """
    source = document["source"]
    encoded = text.encode("utf-8")
    files = document["files"] | {
        DATASET: {"sha256": hashlib.sha256(encoded).hexdigest(), "bytes": len(encoded)}
    }
    poses = sum(len(subject["poses"]) for subject in document["subjects"])
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": document["name"],
        "description": "DeFAUST, a benchmark for the deformation of large meshes by handles: "
        f"{source['title']}, {counted(len(document['subjects']), 'subject', 'subjects')} at rest and "
        f"{counted(poses, 'target pose', 'target poses')}. "
        f"{CARD} is the dataset card.",
        "version": f"{document['format']}.0.0+{document['checksum'][:16]}",
        "license": source["licence"],
        "citeAs": source["citation"],
        "isLiveDataset": False,
        "distribution": [
            *(_file(name, entry) for name, entry in files.items()),
            {
                "@type": "cr:FileSet",
                "@id": POSES,
                "description": "Handles of each pose.",
                "encodingFormat": ENCODINGS[".json"],
                "includes": "subject_*/pose_*.json",
            },
        ],
        "recordSet": [_cases(document), _handles(regions=has_regions(document))],
    }


def _file(name: str, entry: dict[str, Any]) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": name,
        "contentSize": f"{entry['bytes']} B",
        "encodingFormat": ENCODINGS[name[name.rindex(".") :]],
        "sha256": entry["sha256"],
    }


def _cases(document: dict[str, Any]) -> dict[str, Any]:
    """Record set of the cases, whose records are part of croissant.json."""
    texts = {
        "subject": ("sc:Integer", "Number of the subject."),
        "pose": ("sc:Integer", "Number of the pose, from 1."),
        "name": ("sc:Text", "Name of the pose in the source."),
        "static": ("sc:Integer", "Landmarks that stay."),
        "dynamic": ("sc:Integer", "Landmarks that move."),
        "rest": ("sc:Text", "Rest mesh at high resolution, the mesh to deform."),
        "rest_low": ("sc:Text", "Registered rest mesh."),
        "handles": ("sc:Text", "Handles of the pose."),
        "target": ("sc:Text", "Registered target pose; empty if there is none."),
    }
    records = []
    for subject in document["subjects"]:
        for pose in subject["poses"]:
            names = {"rest": REST, "rest_low": REST_LOW, "handles": pose_file(pose["pose"])}
            names["target"] = pose_mesh(pose["pose"]) if pose.get("registered", True) else ""
            folder = subject_folder(subject["subject"])
            facts = {"subject": subject["subject"]} | pose
            facts |= {key: name and f"{folder}/{name}" for key, name in names.items()}
            records.append({f"cases/{key}": facts[key] for key in texts})
    fields = [_field(f"cases/{key}", kind, text) for key, (kind, text) in texts.items()]
    return _record_set("cases", "One subject and pose.", fields) | {"data": records}


def _handles(*, regions: bool) -> dict[str, Any]:
    """Record set of the handles, which readers extract from the files of the poses."""
    texts = {
        "landmark": ("sc:Text", "Name of the landmark or region."),
        "kind": ("sc:Text", "static, dynamic or unused."),
    }
    if regions:
        texts |= {
            "boxes": ("sc:Float", "Boxes whose union contains the region's vertices, each by two corners."),
            "rotation": ("sc:Float", "Rotation matrix of the region, rows first."),
            "translation": ("sc:Float", "Translation of the region after its rotation."),
        }
    else:
        texts |= {
            "source": ("sc:Float", "Positions at rest, three coordinates each."),
            "target": (
                "sc:Float",
                "Positions in the pose, three coordinates each; static handles stay at source.",
            ),
        }
    fields = [
        _field("handles/file", "sc:Text", "File of the pose.")
        | {"source": {"fileSet": {"@id": POSES}, "extract": {"fileProperty": "fullpath"}}}
    ]
    for key, (kind, text) in texts.items():
        field = _field(f"handles/{key}", kind, text)
        field["source"] = {"fileSet": {"@id": POSES}, "extract": {"jsonPath": f"handles[*].{key}"}}
        fields.append(field | ({"repeated": True} if kind == "sc:Float" else {}))
    return _record_set("handles", "The handles of one landmark or region in one pose.", fields)


def _record_set(name: str, text: str, fields: list[dict[str, Any]]) -> dict[str, Any]:
    return {"@type": "cr:RecordSet", "@id": name, "name": name, "description": text, "field": fields}


def _field(name: str, kind: str, text: str) -> dict[str, Any]:
    return {"@type": "cr:Field", "@id": name, "name": name, "description": text, "dataType": kind}
