"""Examples that the OpenAPI document shows; a test holds each of them against the schema of its endpoint."""

from __future__ import annotations

from typing import Any, Final

RUN_ID: Final = "r1ng219w3v1ks"
FRAME_ID: Final = f"{RUN_ID}.5.0.0"
#: Of a page: what its `next` holds is opaque.
CURSOR: Final = "WzVd"
DIGEST: Final = "5f0c3a9be1d24c7788a6e0f1b2c3d4e5"
ETAG: Final = f'"{DIGEST}"'
_DIGESTS: Final = {
    "background": DIGEST,
    "layer": "7d1e8b42f0aa4c0f9e55b1c2d3e4f5a6",
    "truth": "0b9a8c7d6e5f40312233445566778899",
}
_CLASSES: Final = {"engine": "raster-llvmpipe-mesa-22.3.6", "infer": "torch-2.9.0-cpu-fp32"}

#: The paper's two lists (section 4) in its own notation.
SPEC: Final[dict[str, Any]] = {
    "name": "two lists of the paper",
    "asset": "urban-street",
    "parameters": [
        ["p1", "scene.person-1.pos.x", "FLOAT", 0.0, 20.0],
        ["p2", "scene.person-1.pos.y", "FLOAT", 0.0, 10.0],
    ],
    "vary": [["p1", "HOMOGENEOUS", 1.5, 5.5, 1.0], ["p2", "HOMOGENEOUS", 4.0, 5.0, 1.0]],
    "functions": ["deeplabv3plus-small"],
}

_STAGES: Final = {
    "render": {"done": 24, "total": 30, "failed": 0, "running": 6, "rate_per_s": 6.1, "eta_s": 1.0},
    "infer": {"done": 18, "total": 30, "failed": 0, "running": 6, "rate_per_s": 4.0, "eta_s": 3.0},
    "eval": {"done": 17, "total": 30, "failed": 0, "running": 1, "rate_per_s": 4.0, "eta_s": 3.3},
}
PROGRESS: Final[dict[str, Any]] = {
    "state": "running",
    "reason": None,
    "variants": {"total": 10, "fed": 10, "rejected": 0},
    "stages": _STAGES,
    "updated_at": 1764000000.0,
}
RUN: Final[dict[str, Any]] = {
    "id": RUN_ID,
    "name": "two lists of the paper",
    "state": "running",
    "reason": None,
    "spec_digest": "9c2f4b1de8a04d6fb1c3a5e7f9081726",
    "asset_digest": "1a2b3c4d5e6f708192a3b4c5d6e7f809",
    "parent_run": None,
    "iteration": 0,
    "variant_count": 10,
    "rejected_count": 0,
    "pins": {"engine": {"name": "raster", "numeric_class": _CLASSES["engine"], "revision": 1}},
    "stages": _STAGES,
    "created_at": "2026-11-21T02:43:08Z",
    "started_at": "2026-11-21T02:43:09Z",
    "finished_at": None,
}

_ASSIGNMENT: Final = {"scene.person-1.pos.x": 3.5, "scene.person-1.pos.y": 5.0}
VARIANT: Final[dict[str, Any]] = {"index": 5, "block": 0, "assignment": _ASSIGNMENT, "rejection": None}
FRAME: Final[dict[str, Any]] = {
    "id": FRAME_ID,
    "variant_index": 5,
    "camera": "camera-1",
    "time_index": 0,
    "time_s": 0.0,
    **_DIGESTS,
    "state": "done",
}
_IMAGE: Final = f"/v1/frames/{RUN_ID}.5.0.0/image"
_FUNCTION_IMAGE: Final = "function=deeplabv3plus-small&sensor=default"
FRAME_DETAIL: Final[dict[str, Any]] = {
    **FRAME,
    "run_id": RUN_ID,
    "width": 960,
    "height": 540,
    "assignment": _ASSIGNMENT,
    "persons": [
        {
            "instance_id": 24001,
            "character": "yellow-shirt",
            "pixel_area": 2190,
            "pixel_area_percent": 0.4225,
            "pixel_area_amodal": 2310,
            "occlusion_rate": 0.0519,
            "truncation_rate": 0.0,
            "distance_m": 17.09,
            "depth_m": 17.0,
            "bearing_deg": 4.6,
            "aspect_deg": -1.9,
            "irradiance": 0.71,
            "shadow_share": 0.13,
            "contrast": 0.22,
            "box": [516, 242, 552, 371],
            "amodal_box": [514, 242, 552, 371],
            "undefined_reason": None,
        }
    ],
    "evaluations": [
        {
            "sensor": "default",
            "function": "deeplabv3plus-small",
            "prediction": "c4d5e6f708192a3b1a2b3c4d5e6f7081",
            "scores": "e6f708192a3bc4d51a2b3c4d5e6f7081",
            "state": "done",
            "tp": 1980,
            "fp": 310,
            "fn": 210,
            "tn": 515900,
            "pacc": 0.9041,
            "precision": 0.8646,
            "iou": 0.792,
            "pixel_accuracy": 0.9413,
            "miou": 0.6122,
            "fwiou": 0.9011,
            "macc": 0.6904,
            "judged_by": [],
            "persons": [{"instance_id": 24001, "tp": 1980, "fn": 210, "pacc": 0.9041}],
            "images": {
                kind: f"{_IMAGE}?kind={kind}&{_FUNCTION_IMAGE}"
                for kind in ("picture", "prediction", "overlay", "errors")
            },
        }
    ],
    "sequence": None,
    "annotations": {},
    "images": {kind: f"{_IMAGE}?kind={kind}" for kind in ("picture", "truth", "truth-overlay", "instances", "depth")},
    "previous": f"{RUN_ID}.4.2.0",
    "next": f"{RUN_ID}.5.1.0",
}

EVALUATIONS: Final[dict[str, Any]] = {
    "items": [
        {
            "run_id": RUN_ID,
            "variant_index": 5,
            "frame_id": FRAME_ID,
            "camera": "camera-1",
            "time_s": 0.0,
            "character": "yellow-shirt",
            "sensor": "default",
            "function": "deeplabv3plus-small",
            "instance_id": 24001,
            "pixel_area": 2190,
            "pixel_area_percent": 0.4225,
            "pixel_area_amodal": 2310,
            "occlusion_rate": 0.0519,
            "truncation_rate": 0.0,
            "distance_m": 17.09,
            "depth_m": 17.0,
            "bearing_deg": 4.6,
            "aspect_deg": -1.9,
            "irradiance": 0.71,
            "shadow_share": 0.13,
            "contrast": 0.22,
            "sun_azimuth_deg": 140.0,
            "sun_elevation_deg": 35.0,
            "road_friction": 0.85,
            "tp": 1980,
            "fn": 210,
            "pacc": 0.9041,
            "undefined_reason": None,
            "precision": 0.8646,
            "iou": 0.792,
            "pixel_accuracy": 0.9413,
            "fp": 310,
            **_ASSIGNMENT,
        }
    ],
    "total": 30,
    "next": "WzE3LjA5LDUsMCwwLDAsMCwyNDAwMV0",
}
CSV: Final = "".join(
    ",".join(map(str, row)) + "\n" for row in (EVALUATIONS["items"][0], EVALUATIONS["items"][0].values())
)
POINTS: Final[dict[str, Any]] = {
    "column": "distance_m",
    "functions": ["deeplabv3plus-small"],
    "sensors": ["default"],
    "cameras": ["camera-1", "camera-2", "camera-3"],
    "characters": ["yellow-shirt"],
    "x": [17.09],
    "pacc": [0.9041],
    "variant": [5],
    "camera": [0],
    "time": [0],
    "sensor": [0],
    "function": [0],
    "character": [0],
    "instance": [24001],
    "undefined": {"fully hidden": 2},
    "share": 1.0,
    "axes": [{"column": "distance_m", "title": "distance", "unit": "m", "scale": 1.0, "group": "person"}],
}
SUMMARY: Final[dict[str, Any]] = {
    "summary": {
        "threshold": 0.5,
        "frames": 30,
        "rows": [
            {
                "function": "deeplabv3plus-small",
                "sensor": "default",
                "character": "yellow-shirt",
                "frames": 30,
                "persons": 30,
                "defined": 28,
                "undefined": {"fully hidden": 2},
                "pacc_mean": 0.871,
                "pacc_mean_interval": {"low": 0.83, "high": 0.905},
                "pacc_min": 0.312,
                "pacc_max": 0.984,
                "pacc_pooled": 0.889,
                "precision_mean": 0.842,
                "precision_pooled": 0.851,
                "iou_mean": 0.748,
                "iou_pooled": 0.769,
                "detected": 26,
                "detection_rate": 0.9286,
                "detection_interval": {"low": 0.774, "high": 0.98},
            }
        ],
        "occlusion": [{"character": "yellow-shirt", "persons": 30, "occluded": 4}],
        "empty": [],
    },
    "findings": {"items": [], "examined": 6, "held": 0, "level": 0.95, "resamples": 2000, "seed": 0, "unpaired": []},
}
VARIANTS_PLANNED: Final = [{"index": 0, "values": {"p1": 1.5, "p2": 4.0}, "rejection": None}]
PLAN: Final[dict[str, Any]] = {
    "name": SPEC["name"],
    "asset": "urban-street",
    "spec_digest": RUN["spec_digest"],
    "variants": 10,
    "accepted": 10,
    "rejected": {},
    "cameras": ["camera-1", "camera-2", "camera-3"],
    "frames": 30,
    "evaluations": 30,
    "renders": 63,
    "inferences": 30,
    "products": [
        {
            "kind": "layer",
            "maker": "raster",
            "needed": 30,
            "present": 0,
            "cpu_seconds": 10.2,
            "bytes": 1900000,
            "basis": "shipped",
        }
    ],
    "cpu_seconds": 41.5,
    "bytes": 24000000,
    "cost_basis": "shipped table: layer raster",
    "first": VARIANTS_PLANNED,
    "last": [{"index": 9, "values": {"p1": 5.5, "p2": 5.0}, "rejection": None}],
    "units": {"p1": "m", "p2": "m"},
    "estimated": False,
    "sample": None,
    "warnings": [],
    "notes": [],
}
FAILURES: Final[list[dict[str, Any]]] = [
    {
        "variant_index": 4,
        "camera_index": 0,
        "time_index": 0,
        "digest": _DIGESTS["layer"],
        "kind": "layer",
        "error": {
            "stage": "layer",
            "type": "RenderingError",
            "message": "raster: the image is constant",
            "attempts": 1,
        },
    }
]
REJECTIONS: Final[dict[str, int]] = {"person-1 stands inside car-3": 2}
ASSETS: Final[list[dict[str, Any]]] = [
    {
        "name": "urban-street",
        "title": "Urban street",
        "digest": RUN["asset_digest"],
        "cameras": ["camera-1", "camera-2", "camera-3"],
        "problem": None,
    }
]
ASSET: Final[dict[str, Any]] = {
    "name": "urban-street",
    "digest": RUN["asset_digest"],
    "title": "Urban street",
    "description": "A generated street of 165 m with houses, trees, vehicles and pedestrians.",
    "cameras": ["camera-1", "camera-2", "camera-3"],
    "persons": ["scene.person-1", "scene.person-2"],
    "movable": ["scene.person-1", "scene.person-2"],
    "parameters": [
        {
            "path": "scene.person-1.pos.x",
            "type": "FLOAT",
            "minimum": -10.0,
            "maximum": 20.0,
            "unit": "m",
            "default": 3.0,
            "affects": "geometry",
        }
    ],
}
RENDERERS: Final[list[dict[str, Any]]] = [{"name": "raster", "numeric_classes": [_CLASSES["engine"]]}]
_CARD: Final = [
    ["digest", "3f1d0c5b7a9e42861c0d9e8f7a6b5c4d"],
    ["kind", "onnx"],
    ["classes", "3: road, person, everything else → void"],
    ["answers", "logits"],
    ["judged by", "road, person"],
    ["input size", "the frame's own, padded to multiples of 32"],
    ["normalisation", "x / 255"],
    ["channel order", "RGB"],
    ["engine", "openvino"],
    ["precision", "fp32"],
    ["file", "onnx, 16,042,000 bytes"],
    ["opset", "17"],
    ["producer", "pytorch 2.13.0"],
    ["source", "street-net.onnx"],
]
_REGISTERED: Final[dict[str, Any]] = {
    "name": "street-net",
    "digest": "3f1d0c5b7a9e42861c0d9e8f7a6b5c4d",
    "architecture": "onnx",
    "precision": "fp32",
    "engine": "openvino",
    "provenance": {"source": "street-net.onnx", "producer": "pytorch 2.13.0", "opset": "17"},
    "numeric_classes": ["openvino-2026.4.1-cpu-fp32-amx-t2"],
    "problem": None,
    "reference": "street-net@3f1d0c5b7a9e",
    "kind": "onnx",
    "version": 1,
    "classes": ["road", "person"],
    "unmapped": ["everything else"],
    "judged_by": ["road", "person"],
    "card": _CARD,
    "created_at": "2026-11-21T06:40:00Z",
}
FUNCTIONS: Final[list[dict[str, Any]]] = [
    {
        "name": "deeplabv3plus-small",
        "digest": "d" * 64,
        "architecture": "deeplabv3plus-small",
        "precision": "fp32",
        "engine": "torch",
        "provenance": {"licence": "Apache-2.0"},
        "numeric_classes": [_CLASSES["infer"]],
        "problem": None,
        "reference": None,
        "kind": "network",
        "version": None,
        "classes": ["road", "person"],
        "unmapped": [],
        "judged_by": [],
        "card": [["digest", "d" * 64], ["kind", "network"], ["architecture", "deeplabv3plus-small"]],
        "created_at": None,
    },
    _REGISTERED,
]
FUNCTION: Final[dict[str, Any]] = {
    **_REGISTERED,
    "document": {
        "name": "street-net",
        "kind": "onnx",
        "payload": {"sha256": "e0" * 32, "bytes": 16_042_000, "format": "onnx"},
        "output": {"kind": "logits", "classes": ["road", "person", "everything else"]},
        "engine": "openvino",
        "precision": "fp32",
    },
    "check": {
        "numeric_class": "openvino-2026.4.1-cpu-fp32-amx-t1",
        "precision": "fp32",
        "picture": [256, 128],
        "cpu_seconds": 0.021,
    },
}
REGISTRATION: Final = {
    "document": "name: street-net\nclasses: [road, person]\n",
    "payload": "(the file)",
    "engine": "openvino",
}
PREDICTION: Final[dict[str, Any]] = {"frame_id": FRAME_ID, "new": True}
LABELS: Final[list[dict[str, Any]]] = [
    {
        "name": "person",
        "id": 24,
        "train_id": 11,
        "category": "human",
        "has_instances": True,
        "color": [220, 20, 60],
    }
]
WORKERS: Final[list[dict[str, Any]]] = [
    {
        "id": "workstation-4711-1f2e3d4c",
        "stage": "infer",
        "host": "workstation",
        "pid": 4711,
        "offers": [{"stage": "infer", "name": "deeplabv3plus-small", "numeric_class": _CLASSES["infer"]}],
        "started_at": 1764000000.0,
        "seen_at": 1764000042.0,
    }
]
QUEUES: Final[list[dict[str, Any]]] = [
    {"route": f"infer.{_CLASSES['infer']}", "waiting": 6, "ready": 12, "running": 6, "messages": 2, "workers": 1}
]
METRICS: Final = '# HELP valerie_products Unfinished products\nvalerie_products{route="eval",state="ready"} 3.0\n'
