"""Export and check of evidence, over a run of the blank engine."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import stat
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_pem_public_key
from google.protobuf import json_format
from in_toto_attestation.v1 import statement_pb2
from in_toto_attestation.v1.statement import Statement
from PIL import Image
from rocrate.rocrate import ROCrate

from tests.planted_tables import planted_finding
from tests.world.blank import Pipeline, completed_run
from valerie.analysis.findings.findings import ScoredPerson
from valerie.errors import Conflict, InvalidInput, NotFound
from valerie.pipeline.base.run_artifacts import SUMMARY
from valerie.pipeline.evidence import evidence_manifest as limits
from valerie.pipeline.evidence.evidence_manifest import Refused, merkle_root
from valerie.pipeline.evidence.exporting import export_evidence
from valerie.pipeline.evidence.replaying import replay
from valerie.pipeline.evidence.signing import new_key
from valerie.pipeline.evidence.verifying import verify
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.resolving.spec import parse
from valerie.storage.keys import run_key

REQUIREMENT = {"id": "R-1", "text": "Persons are seen.", "statistic": "mean(pacc) >= 0.5"}


def name_frames(pipeline: Pipeline, run_id: str) -> None:
    """Let the findings of a run name two of its frames: the blank engine gives no cause for a finding."""
    key = run_key(run_id, SUMMARY)
    summary = json.loads(pipeline.context.store.get(key))
    views = [ScoredPerson(f"{run_id}.{place}", "default", "blank", 24001, 0.0) for place in ("5.1.0", "3.0.0")]
    summary["findings"]["items"] = [asdict(planted_finding(*views))]
    pipeline.context.store.put(key, json.dumps(summary).encode(), replace=True)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Pipeline, str]:
    """24 frames, some of which its findings name; only to be read."""
    pipeline, run_id = completed_run(tmp_path_factory.mktemp("run"), requirements=[REQUIREMENT])
    name_frames(pipeline, run_id)
    return pipeline, run_id


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A private key, with the public one beside it."""
    path = tmp_path_factory.mktemp("keys") / "mine"
    new_key(path)
    return path


@pytest.fixture(scope="module")
def exported(run: tuple[Pipeline, str], keys: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A signed folder; only to be read."""
    out = tmp_path_factory.mktemp("exported") / "evidence"
    export_evidence(run[0].context, run[1], out, key=keys)
    return out


@pytest.fixture
def folder(exported: Path, tmp_path: Path) -> Path:
    """A copy of the signed folder, to be tampered with."""
    return Path(shutil.copytree(exported, tmp_path / "copy"))


def public(keys: Path) -> Path:
    return keys.with_name(keys.name + ".pub")


def files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_exporting_a_run_again_gives_equal_bytes(
    run: tuple[Pipeline, str], keys: Path, exported: Path, tmp_path: Path
) -> None:
    export_evidence(run[0].context, run[1], tmp_path / "again", key=keys)
    assert files(tmp_path / "again") == files(exported)


def test_the_folder_holds_the_run_and_exactly_the_frames_that_findings_name(
    run: tuple[Pipeline, str], exported: Path
) -> None:
    pipeline, run_id = run
    named = ("3.0.0", "5.1.0")
    kinds = ("picture", "truth", "prediction-0", "close-up-0-24001")
    frames = {f"frames/{place}/sensor-0-{kind}.png" for place in named for kind in kinds}
    documents = {
        "spec.json", "run.json", "pins.json", "frames.json", "summary.json", "environment.json", "report.html",
        "evaluations.parquet", "evaluations.csv", "ro-crate-metadata.json", "manifest.json", "manifest.dsse.json",
        "register.json", "register.csv", "odd.json", "odd.csv",
    }  # fmt: skip
    assert files(exported).keys() == frames | documents
    place = named[1]
    for kind in ("picture", "truth", "prediction"):
        source = find_picture(pipeline.context, FrameKey.parse(f"{run_id}.{place}"), kind=kind)
        file = exported / f"frames/{place}/sensor-0-{kind}{'-0' if kind == 'prediction' else ''}.png"
        with Image.open(file) as image:
            np.testing.assert_array_equal(np.asarray(image), paint_picture(pipeline.context, source))
    facts = json.loads((exported / "run.json").read_text())
    assert facts["id"] == run_id
    assert parse((exported / "spec.json").read_bytes()).digest == facts["spec_digest"]
    assert json.loads((exported / "environment.json").read_text())["packages"]["numpy"] == np.__version__
    pins = json.loads((exported / "pins.json").read_text())
    assert pins["functions"]["blank"]["card"]["precision"] == "uint8"


def test_the_digest_of_the_table_is_that_of_the_csv_without_run_and_frame_id(exported: Path) -> None:
    lines = (exported / "evaluations.csv").read_text().splitlines()
    fields = [re.findall(r'("[^"]*"|[^,"]*)(?:,|$)', line) for line in lines]
    kept = [i for i, name in enumerate(fields[0]) if name and name not in ('"run_id"', '"frame_id"')]
    assert len(kept) == lines[0].count(",") - 1
    without = "".join(",".join(row[i] for i in kept) + "\n" for row in fields)
    digest = json.loads((exported / "run.json").read_text())["results"]["table"]
    assert digest == sha256(without.encode()).hexdigest()


def test_two_executions_of_a_spec_agree_in_frames_table_and_verdicts(
    run: tuple[Pipeline, str], exported: Path, tmp_path: Path
) -> None:
    pipeline, run_id = completed_run(tmp_path / "other", requirements=[REQUIREMENT])
    name_frames(pipeline, run_id)
    export_evidence(pipeline.context, run_id, tmp_path / "evidence")
    first, second = (json.loads((one / "run.json").read_text()) for one in (exported, tmp_path / "evidence"))
    assert first["id"] != second["id"]
    assert first["results"] == second["results"]
    verdicts = json.loads((exported / "summary.json").read_text())["verdicts"]
    assert [verdict["id"] for verdict in verdicts] == ["R-1"]
    text = json.dumps(verdicts, indent=2, sort_keys=True, ensure_ascii=False) + "\n"
    assert first["results"]["verdicts"] == sha256(text.encode()).hexdigest()


def test_a_run_that_has_not_ended_has_no_evidence(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run
    unfinished = pipeline.submit({**pipeline.row(run_id).spec.model_dump(mode="json"), "name": "waiting"})
    with pytest.raises(Conflict, match=r"is submitted and has no .*; a run gets one when it completes"):
        export_evidence(pipeline.context, unfinished, tmp_path / "evidence")
    with pytest.raises(NotFound):
        export_evidence(pipeline.context, "r0000000000", tmp_path / "evidence")
    (tmp_path / "full").mkdir()
    (tmp_path / "full/file").touch()
    with pytest.raises(Conflict, match="exists already"):
        export_evidence(pipeline.context, run_id, tmp_path / "full")
    assert [path.name for path in tmp_path.iterdir()] == ["full"]


def test_the_folder_is_an_ro_crate_that_names_every_file_but_its_own_and_the_envelope(exported: Path) -> None:
    crate = ROCrate(exported)
    assert crate.version == "1.2"
    assert crate.root_dataset["datePublished"] == json.loads((exported / "run.json").read_text())[
        "finished_at"
    ].replace("Z", "+00:00")
    named = {entity.id for entity in crate.data_entities}
    assert named == files(exported).keys() - {"ro-crate-metadata.json", "manifest.dsse.json"}
    assert all(entity["name"] and entity["encodingFormat"] for entity in crate.data_entities)


def test_the_manifest_is_an_in_toto_statement_that_sha256sum_and_rfc_6962_confirm(exported: Path) -> None:
    text = (exported / "manifest.json").read_text()
    statement = json_format.Parse(text, statement_pb2.Statement())
    Statement.copy_from_pb(statement).validate()
    contents = files(exported)
    assert {s.name: s.digest["sha256"] for s in statement.subject} == {
        name: sha256(data).hexdigest() for name, data in contents.items() if not name.startswith("manifest.")
    }
    leaves = [f"{s.digest['sha256']}  {s.name}\n".encode() for s in statement.subject]
    assert statement.predicate["root"] == merkle_root(leaves).hex()


#: Leaves and roots of the tests of Certificate Transparency's reference implementation.
LEAVES = ("", "00", "10", "2021", "3031", "40414243", "5051525354555657", "606162636465666768696a6b6c6d6e6f")
ROOTS = {
    0: "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855",
    1: "6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d",
    2: "fac54203e7cc696cf0dfcb42c92a1d9dbaf70ad9e621f4bd8d98662f00e3c125",
    3: "aeb6bcfe274b70a14fb067a5e5578264db0fa9b51af5e0ba159158f329e06e77",
    5: "4e3bbb1f7b478dcfe71fb631631519a3bca12c9aefca1612bfce4c13a86264d4",
    8: "5dc9da79a70659a9ad559cb701ded9a2ab9d823aad2f4960cfe370eff4604328",
}


@pytest.mark.parametrize("count", ROOTS)
def test_the_tree_has_the_published_roots(count: int) -> None:
    assert merkle_root([bytes.fromhex(leaf) for leaf in LEAVES[:count]]).hex() == ROOTS[count]


def test_the_envelope_is_signed_as_dsse_defines(exported: Path, keys: Path) -> None:
    envelope = json.loads((exported / "manifest.dsse.json").read_text())
    payload = base64.b64decode(envelope["payload"], validate=True)
    assert payload == (exported / "manifest.json").read_bytes()
    kind = envelope["payloadType"].encode()
    assert kind == b"application/vnd.in-toto+json"
    encoded = b" ".join([b"DSSEv1", b"%d" % len(kind), kind, b"%d" % len(payload), payload])
    (signature,) = envelope["signatures"]
    key: Any = load_pem_public_key(public(keys).read_bytes())
    key.verify(base64.b64decode(signature["sig"], validate=True), encoded)


def test_a_key_pair_belongs_together_is_private_and_is_never_replaced(tmp_path: Path) -> None:
    path = tmp_path / "key"
    new_key(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    private: Any = load_pem_private_key(path.read_bytes(), None)
    assert private.public_key() == load_pem_public_key(public(path).read_bytes())
    with pytest.raises(Conflict, match="never replaced"):
        new_key(path)


def test_a_signed_folder_holds_and_names_its_signer_only_to_those_who_have_the_key(exported: Path, keys: Path) -> None:
    with_key, without = verify(exported, key=public(keys)), verify(exported)
    assert with_key.signer is not None
    assert (without.signed, without.signer) == (True, None)
    assert with_key.root == without.root == json.loads((exported / "manifest.json").read_text())["predicate"]["root"]


def test_an_unsigned_folder_holds_but_not_for_a_key(run: tuple[Pipeline, str], keys: Path, tmp_path: Path) -> None:
    evidence = export_evidence(run[0].context, run[1], tmp_path / "unsigned")
    assert (evidence.signer, verify(tmp_path / "unsigned").signed) == (None, False)
    with pytest.raises(Refused, match=r"manifest\.dsse\.json: missing\. The folder is not signed"):
        verify(tmp_path / "unsigned", key=public(keys))


def test_another_key_did_not_sign(exported: Path, tmp_path: Path) -> None:
    new_key(tmp_path / "other")
    with pytest.raises(Refused, match=r"manifest\.dsse\.json: not signed by the key"):
        verify(exported, key=tmp_path / "other.pub")


def test_what_is_no_key_is_refused(run: tuple[Pipeline, str], exported: Path, keys: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="not a public Ed25519 key"):
        verify(exported, key=keys)
    with pytest.raises(InvalidInput, match="cannot be read"):
        verify(exported, key=tmp_path / "nowhere")
    with pytest.raises(InvalidInput, match="not a private Ed25519 key"):
        export_evidence(run[0].context, run[1], tmp_path / "evidence", key=public(keys))


def test_one_flipped_bit_is_found_in_every_file_and_all_over_manifest_and_envelope(folder: Path, keys: Path) -> None:
    for name, data in files(folder).items():
        every = range(0, len(data), 97) if name.startswith("manifest") else (0, len(data) // 2, len(data) - 1)
        for place in every:
            flipped = bytearray(data)
            flipped[place] ^= 1
            (folder / name).write_bytes(flipped)
            with pytest.raises(Refused) as refusal:
                verify(folder, key=public(keys))
            assert any(problem.startswith(f"{name}: ") for problem in refusal.value.problems), (name, place)
        (folder / name).write_bytes(data)
    verify(folder, key=public(keys))


def refused(folder: Path) -> str:
    with pytest.raises(Refused) as refusal:
        verify(folder)
    return str(refusal.value)


def test_an_empty_folder_is_named(folder: Path) -> None:
    (folder / "more/inside").mkdir(parents=True)
    assert refused(folder).splitlines() == ["more: an empty folder", "more/inside: an empty folder"]


def test_missing_and_additional_files_are_named(folder: Path) -> None:
    (folder / "spec.json").unlink()
    (folder / "more").mkdir()
    (folder / "more/notes.txt").write_text("hello")
    assert refused(folder).splitlines() == ["spec.json: missing", "more/notes.txt: not in the manifest"]
    shutil.rmtree(folder)
    with pytest.raises(InvalidInput, match="not a folder"):
        verify(folder)
    folder.mkdir()
    assert refused(folder) == "manifest.json: missing"


def test_links_and_other_things_than_files_are_never_opened(folder: Path, tmp_path: Path) -> None:
    shutil.copy(folder / "spec.json", tmp_path / "spec.json")
    (folder / "spec.json").unlink()
    (folder / "spec.json").symlink_to(tmp_path / "spec.json")
    (folder / "linked").symlink_to(tmp_path, target_is_directory=True)
    os.mkfifo(folder / "pipe")
    assert sorted(refused(folder).splitlines()) == [
        "linked: a symbolic link",
        "pipe: neither a file nor a folder",
        "spec.json: a symbolic link",
    ]
    for name in ("spec.json", "linked", "pipe"):
        (folder / name).unlink()
    (folder / "manifest.json").unlink()
    (folder / "manifest.json").symlink_to("/dev/zero")
    assert refused(folder) == "manifest.json: a symbolic link"


@pytest.mark.parametrize(
    "name", ["../outside", "/etc/hosts", "frames/../../outside", "a//b", ".hidden", "a\\b", "manifest.json"]
)
def test_a_path_that_leads_out_of_the_folder_is_refused(folder: Path, name: str) -> None:
    document = json.loads((folder / "manifest.json").read_text())
    document["subject"] = [{"name": name, "digest": {"sha256": "0" * 64}}]
    (folder / "manifest.json").write_text(json.dumps(document))
    assert "manifest.json: " in refused(folder)
    assert repr(name) in refused(folder)


def test_a_file_with_a_name_that_no_manifest_holds_is_refused(folder: Path) -> None:
    (folder / "a\nb").touch()
    assert "'a\\nb': not a path" in refused(folder)


def test_the_limits_hold_before_anything_is_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (folder / "huge").open("wb") as stream:
        stream.truncate(limits.MAX_BYTES)  # sparse
    assert refused(folder).startswith(f"huge: {limits.MAX_BYTES:,} of ")
    (folder / "huge").unlink()
    with (folder / "manifest.json").open("ab") as stream:
        stream.truncate(limits.MAX_DOCUMENT_BYTES + 1)
    assert refused(folder) == f"manifest.json: larger than {limits.MAX_DOCUMENT_BYTES:,} bytes"
    deep = folder / "/".join("abcdefghi")
    deep.mkdir(parents=True)
    assert "at most 8 deep" in refused(folder)


def test_too_many_files_are_refused_with_the_subfolder_that_holds_most_of_them(folder: Path) -> None:
    (folder / "many" / "more").mkdir(parents=True)
    few = sum(path.is_file() for path in folder.rglob("*"))
    for number in range(limits.MAX_FILES):
        os.mknod(folder / f"many/more/{number}")
    total, most = few + limits.MAX_FILES, limits.MAX_FILES
    limit = f"limit: {limits.MAX_FILES:,} files"
    assert refused(folder) == f"many/more: holds {most:,} of {total:,} files, more than any other folder; {limit}"
    for number in range(limits.MAX_FILES):
        os.mknod(folder / f"many/more/further-{number}")
    # Then the search ends early.
    assert re.fullmatch(
        rf"many/more: holds \d+,\d+ of the first 20,000 files and folders, more than any other folder; {limit}",
        refused(folder),
    )


def test_frames_can_be_made_again_from_the_folder_alone(run: tuple[Pipeline, str], folder: Path) -> None:
    settings = run[0].settings.model_copy(update={"database_url": "sqlite:////nowhere", "artifacts_url": "/nowhere"})
    replayed = replay(folder, 99, settings)
    assert {picture.file for picture in replayed} == {name for name in files(folder) if name.endswith(".png")}
    assert {picture.verdict for picture in replayed} == {"equal"}
    assert len(replay(folder, 1, settings)) == 4
    picture = next(folder.rglob("*-picture.png"))
    shutil.copy(picture.with_name("sensor-0-truth.png"), picture)
    differing = {one.file for one in replay(folder, 99, settings) if one.verdict == "differs"}
    assert differing == {picture.relative_to(folder).as_posix()}


def test_a_replay_says_what_this_machine_lacks(run: tuple[Pipeline, str], folder: Path, tmp_path: Path) -> None:
    without_assets = run[0].settings.model_copy(update={"asset_dir": tmp_path})
    (picture,) = replay(folder, 1, without_assets)
    assert picture.verdict.startswith("cannot be made here: ")
    assert "box-street" in picture.verdict
    pins = json.loads((folder / "pins.json").read_text())
    pins["engine"]["numeric_class"] = "another driver"
    (folder / "pins.json").write_text(json.dumps(pins))
    verdicts = {picture.verdict for picture in replay(folder, 1, run[0].settings)}
    assert verdicts == {"cannot be made here: blank runs as blank here, but the run pinned another driver"}


def test_a_replay_refuses_frames_that_the_spec_has_not(run: tuple[Pipeline, str], folder: Path) -> None:
    listed = json.loads((folder / "frames.json").read_text())
    listed["frames"] = [listed["frames"][0] | {"variant": 10**6}]
    (folder / "frames.json").write_text(json.dumps(listed))
    with pytest.raises(Refused, match="is not a frame of the spec"):
        replay(folder, 1, run[0].settings)
