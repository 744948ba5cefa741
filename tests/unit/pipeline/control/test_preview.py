"""The child process of previews: whatever it does, the request gets an answer, and the next one gets a new child."""

from __future__ import annotations

import base64
import json
import struct
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from threading import Thread

import pytest

from tests.world.drawn import DrawnWorld, spec
from tests.world.world import settings_of
from valerie.errors import MissingDependency, RenderingError, TransientError
from valerie.pipeline.control import preview
from valerie.pipeline.control.preview import Previewed, Previews
from valerie.runs.resolving.spec import parse

PICTURE = base64.b64encode(b"picture").decode()
#: Reads a job.
READ = "import struct, sys, time; sys.stdin.buffer.read(struct.unpack('<I', sys.stdin.buffer.read(4))[0]);"


def previews(tmp_path: Path, program: str, *, seconds: float = 60.0) -> Previews:
    world = DrawnWorld(settings_of(tmp_path))
    return Previews(world.context, command=[sys.executable, "-c", program], seconds=seconds)


def previewed(tmp_path: Path, program: str, renderer: object, *, seconds: float = 60.0) -> Previewed:
    with closing(previews(tmp_path, program, seconds=seconds)) as rendering:
        return rendering.render(parse(spec("n", renderer=renderer)), [0])


def answering(*documents: dict[str, object]) -> str:
    """A program that answers one job after the other."""
    answers = [json.dumps(document).encode() for document in documents]
    steps = [
        f"{READ} sys.stdout.buffer.write({struct.pack('<I', len(data)) + data!r}); sys.stdout.flush();"
        for data in answers
    ]
    return f"{' '.join(steps)} time.sleep(600)"


def test_a_child_that_hangs_is_ended(tmp_path: Path) -> None:
    hanging = previews(tmp_path, f"{READ} time.sleep(600)", seconds=1.0)
    with pytest.raises(TransientError, match="longer than 1 s"):
        hanging.render(parse(spec("n")), [0])


def test_a_request_behind_a_long_one_is_told_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preview, "PATIENCE_SECONDS", 0.1)
    started = tmp_path / "started"
    busy = previews(tmp_path, f"{READ} open({str(started)!r}, 'w'); time.sleep(600)", seconds=2.0)
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(busy.render, parse(spec("n")), [0])
        while not started.exists():
            time.sleep(0.01)
        with pytest.raises(TransientError, match="another preview is being rendered; try again"):
            busy.render(parse(spec("n")), [0])
    assert "longer than 2 s" in str(first.exception())


@pytest.mark.parametrize("program", ["raise SystemExit(1)", f"{READ} raise SystemExit(1)", answering({"odd": 1})])
def test_a_child_that_ends_or_talks_nonsense_is_replaced(tmp_path: Path, program: str) -> None:
    ending = previews(tmp_path, program)
    for _ in range(2):
        with pytest.raises(TransientError, match="ended"):
            ending.render(parse(spec("n")), [0])


def test_the_child_outlives_the_thread_whose_request_started_it(tmp_path: Path) -> None:
    """Linux tells a child of its parent's end when the *thread* ends that started it, and servers end idle threads."""
    pictures = ({"pictures": [name]} for name in ("first", "second"))
    tied = f"from valerie.parent import end_with_parent; end_with_parent(); {answering(*pictures)}"
    with closing(previews(tmp_path, tied)) as rendering:
        shown: list[str | None] = []
        for _ in range(2):
            thread = Thread(target=lambda: shown.append(rendering.render(parse(spec("n")), [0]).variants[0].picture))
            thread.start()
            thread.join()
    assert shown == ["first", "second"]


def test_a_machine_without_an_engine_refuses_politely(tmp_path: Path) -> None:
    missing = previews(tmp_path, answering({"error": "moderngl is not installed", "engine_missing": True}))
    with pytest.raises(MissingDependency, match="cannot render previews: moderngl"):
        missing.render(parse(spec("n")), [0])
    missing.close()


def test_the_engine_s_refusal_is_passed_on(tmp_path: Path) -> None:
    refusing = previews(tmp_path, answering({"error": "the image is constant"}))
    with pytest.raises(RenderingError, match="the image is constant"):
        refusing.render(parse(spec("n")), [0])
    refusing.close()


def test_no_child_is_started_for_rejected_variants(tmp_path: Path) -> None:
    never = previews(tmp_path, "raise SystemExit(1)")
    document = spec("n")
    rejected = 23
    (answer,) = never.render(parse(document), [rejected]).variants
    assert answer.picture is None
    assert answer.variant.rejection


def test_another_engine_renders_where_the_spec_s_is_missing_and_the_reason_is_passed_on(tmp_path: Path) -> None:
    program = answering({"error": "no Blender here", "engine_missing": True}, {"pictures": [PICTURE]})
    shown = previewed(tmp_path, program, "cycles")
    assert (shown.engine, shown.problem, shown.draft) == ("raster", "no Blender here", {})
    assert [variant.picture for variant in shown.variants] == [PICTURE]


def test_another_engine_renders_where_the_spec_s_takes_too_long(tmp_path: Path) -> None:
    program = f"""
import json, struct, sys, time
job = json.loads(sys.stdin.buffer.read(struct.unpack('<I', sys.stdin.buffer.read(4))[0]))
if job["renderer"] == "cycles":
    time.sleep(600)
data = json.dumps({{"pictures": ["{PICTURE}"]}}).encode()
sys.stdout.buffer.write(struct.pack('<I', len(data)) + data)
sys.stdout.flush()
time.sleep(600)
"""
    shown = previewed(tmp_path, program, "cycles", seconds=2.0)
    assert shown.engine == "raster"
    assert shown.problem == "the preview took longer than 2 s"


def test_the_spec_s_engine_renders_with_its_settings_but_for_those_of_drafts(tmp_path: Path) -> None:
    program = """
import base64, json, struct, sys
job = sys.stdin.buffer.read(struct.unpack('<I', sys.stdin.buffer.read(4))[0])
data = json.dumps({"pictures": [base64.b64encode(job).decode()]}).encode()
sys.stdout.buffer.write(struct.pack('<I', len(data)) + data)
sys.stdout.flush()
sys.stdin.buffer.read()
"""
    shown = previewed(tmp_path, program, {"name": "cycles", "samples": 1024, "max_bounces": 3})
    job = json.loads(base64.b64decode(shown.variants[0].picture or ""))
    assert job["renderer"] == shown.engine == "cycles"
    assert job["settings"] == {"max_bounces": 3, "samples": 8, "denoise": True}
    assert shown.problem is None
