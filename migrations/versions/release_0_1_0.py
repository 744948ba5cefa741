"""all tables of release 0.1.0

Revision: release_0_1_0
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "release_0_1_0"
down_revision = None
branch_labels = None
depends_on = None

_AUDIT_REFUSAL = "the audit log is append-only"
DOCUMENT = sa.JSON().with_variant(postgresql.JSONB(), "postgresql")


def upgrade() -> None:
    op.create_table(
        "studies",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("reason", sa.Text(), nullable=True),
        sa.Column("document", DOCUMENT, nullable=False),
        sa.Column("asset_digest", sa.String(length=32), nullable=False),
        sa.Column("by_hand", sa.Boolean(), nullable=False),
        sa.Column("result", DOCUMENT, nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("finished_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("owner", sa.String(length=200), nullable=True),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_studies")),
    )
    with op.batch_alter_table("studies", schema=None) as batch_op:
        batch_op.create_index("ix_studies_created_at", ["created_at"], unique=False)

    op.create_table(
        "functions",
        sa.Column("name", sa.String(length=64), nullable=False),
        sa.Column("digest", sa.String(length=32), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("document", DOCUMENT, nullable=False),
        sa.Column("payload", sa.String(length=64), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("name", "digest", name=op.f("pk_functions")),
        sa.UniqueConstraint("name", "version", name=op.f("uq_functions_name_version")),
    )
    with op.batch_alter_table("functions", schema=None) as batch_op:
        batch_op.create_index("ix_functions_digest", ["digest"], unique=False)
        batch_op.create_index("ix_functions_payload", ["payload"], unique=False)

    op.create_table(
        "selections",
        sa.Column("name", sa.String(length=120), nullable=False),
        sa.Column("runs", DOCUMENT, nullable=False),
        sa.Column("expression", sa.Text(), nullable=False),
        sa.Column("view", sa.Text(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_selections")),
    )
    op.create_table(
        "leases",
        sa.Column("name", sa.String(length=64), nullable=False),
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("until", sa.Float(), nullable=False),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_leases")),
    )
    op.create_table(
        "products",
        sa.Column("digest", sa.String(length=32), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("route", sa.String(length=120), nullable=False),
        sa.Column("cache_group", sa.String(length=32), nullable=False),
        sa.Column("input_a", sa.String(length=32), nullable=True),
        sa.Column("input_b", sa.String(length=32), nullable=True),
        sa.Column("input_c", sa.String(length=32), nullable=True),
        sa.Column("turn", sa.Float(), nullable=False),
        sa.Column("attempts", sa.Integer(), nullable=False),
        sa.Column("lease_owner", sa.String(length=64), nullable=True),
        sa.Column("lease_until", sa.Float(), nullable=True),
        sa.Column("sent_at", sa.Float(), nullable=True),
        sa.Column("not_before", sa.Float(), nullable=True),
        sa.Column("error", DOCUMENT, nullable=True),
        sa.Column("bytes", sa.BigInteger(), nullable=True),
        sa.Column("pixels", sa.BigInteger(), nullable=True),
        sa.Column("cpu_seconds", sa.Float(), nullable=True),
        sa.Column("finished_at", sa.Float(), nullable=True),
        sa.PrimaryKeyConstraint("digest", name=op.f("pk_products")),
    )
    with op.batch_alter_table("products", schema=None) as batch_op:
        batch_op.create_index(
            "ix_products_ended",
            ["kind", "state", "finished_at", "cpu_seconds"],
            unique=False,
            sqlite_where=sa.text("state IN ('done','failed')"),
            postgresql_where=sa.text("state IN ('done','failed')"),
        )
        batch_op.create_index(
            "ix_products_input_a",
            ["input_a"],
            unique=False,
            sqlite_where=sa.text("state = 'waiting'"),
            postgresql_where=sa.text("state = 'waiting'"),
        )
        batch_op.create_index(
            "ix_products_input_b",
            ["input_b"],
            unique=False,
            sqlite_where=sa.text("state = 'waiting'"),
            postgresql_where=sa.text("state = 'waiting'"),
        )
        batch_op.create_index(
            "ix_products_input_c",
            ["input_c"],
            unique=False,
            sqlite_where=sa.text("state = 'waiting'"),
            postgresql_where=sa.text("state = 'waiting'"),
        )
        batch_op.create_index(
            "ix_products_unfinished",
            ["state", "route", "turn"],
            unique=False,
            sqlite_where=sa.text("state IN ('waiting','ready','running')"),
            postgresql_where=sa.text("state IN ('waiting','ready','running')"),
        )

    op.create_table(
        "runs",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("state", sa.String(length=32), nullable=False),
        sa.Column("reason", sa.Text(), nullable=True),
        sa.Column("spec", DOCUMENT, nullable=False),
        sa.Column("spec_digest", sa.String(length=32), nullable=False),
        sa.Column("asset_digest", sa.String(length=32), nullable=False),
        sa.Column("pins", DOCUMENT, nullable=True),
        sa.Column("parent_run", sa.String(length=32), nullable=True),
        sa.Column("iteration", sa.Integer(), nullable=False),
        sa.Column("variant_count", sa.BigInteger(), nullable=False),
        sa.Column("next_index", sa.BigInteger(), nullable=False),
        sa.Column("rejected_count", sa.BigInteger(), nullable=False),
        sa.Column("priority", sa.String(length=16), nullable=False),
        sa.Column("turn", sa.Float(), nullable=False),
        sa.Column("progress", DOCUMENT, nullable=True),
        sa.Column("idempotency_key", sa.String(length=200), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("started_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("finished_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("owner", sa.String(length=200), nullable=True),
        sa.ForeignKeyConstraint(["parent_run"], ["runs.id"], name=op.f("fk_runs_parent_run"), ondelete="SET NULL"),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_runs")),
        sa.UniqueConstraint("idempotency_key", name=op.f("uq_runs_idempotency_key")),
    )
    with op.batch_alter_table("runs", schema=None) as batch_op:
        batch_op.create_index("ix_runs_created_at", ["created_at"], unique=False)
        batch_op.create_index("ix_runs_state", ["state"], unique=False)

    op.create_table(
        "workers",
        sa.Column("id", sa.String(length=64), nullable=False),
        sa.Column("stage", sa.String(length=16), nullable=False),
        sa.Column("host", sa.String(length=200), nullable=False),
        sa.Column("pid", sa.Integer(), nullable=False),
        sa.Column("offers", DOCUMENT, nullable=False),
        sa.Column("started_at", sa.Float(), nullable=False),
        sa.Column("seen_at", sa.Float(), nullable=False),
        sa.Column("resting", sa.Text(), nullable=True),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_workers")),
    )
    op.create_table(
        "notes",
        sa.Column("run_id", sa.String(length=32), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("name", sa.String(length=1000), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("changed_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_notes_run_id"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("run_id", "kind", "name", name=op.f("pk_notes")),
    )
    op.create_table(
        "tags",
        sa.Column("run_id", sa.String(length=32), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("name", sa.String(length=1000), nullable=False),
        sa.Column("tag", sa.String(length=40), nullable=False),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_tags_run_id"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("run_id", "kind", "name", "tag", name=op.f("pk_tags")),
    )
    with op.batch_alter_table("tags", schema=None) as batch_op:
        batch_op.create_index("ix_tags_tag", ["tag"], unique=False)

    op.create_table(
        "blocks",
        sa.Column("run_id", sa.String(length=32), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("first", sa.BigInteger(), nullable=False),
        sa.Column("last", sa.BigInteger(), nullable=False),
        sa.Column("counts", DOCUMENT, nullable=True),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_blocks_run_id"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("run_id", "number", name=op.f("pk_blocks")),
    )
    op.create_table(
        "person_lights",
        sa.Column("product", sa.String(length=32), nullable=False),
        sa.Column("instance_id", sa.Integer(), nullable=False),
        sa.Column("irradiance", sa.Float(), nullable=True),
        sa.Column("shadow_share", sa.Float(), nullable=True),
        sa.Column("contrast", sa.Float(), nullable=True),
        sa.ForeignKeyConstraint(
            ["product"], ["products.digest"], name=op.f("fk_person_lights_product"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("product", "instance_id", name=op.f("pk_person_lights")),
    )
    op.create_table(
        "person_scores",
        sa.Column("digest", sa.String(length=32), nullable=False),
        sa.Column("instance_id", sa.Integer(), nullable=False),
        sa.Column("tp", sa.Integer(), nullable=False),
        sa.Column("fn", sa.Integer(), nullable=False),
        sa.Column("pacc", sa.Float(), nullable=True),
        sa.Column("pacc_empty", sa.Float(), nullable=True),
        sa.ForeignKeyConstraint(
            ["digest"], ["products.digest"], name=op.f("fk_person_scores_digest"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("digest", "instance_id", name=op.f("pk_person_scores")),
    )
    op.create_table(
        "person_views",
        sa.Column("truth", sa.String(length=32), nullable=False),
        sa.Column("instance_id", sa.Integer(), nullable=False),
        sa.Column("box", DOCUMENT, nullable=True),
        sa.Column("amodal_box", DOCUMENT, nullable=True),
        sa.Column("distance_m", sa.Float(), nullable=True),
        sa.Column("depth_m", sa.Float(), nullable=True),
        sa.Column("bearing_deg", sa.Float(), nullable=True),
        sa.Column("aspect_deg", sa.Float(), nullable=True),
        sa.Column("occlusion_rate", sa.Float(), nullable=True),
        sa.Column("truncation_rate", sa.Float(), nullable=True),
        sa.Column("pixel_area", sa.Integer(), nullable=True),
        sa.Column("pixel_area_percent", sa.Float(), nullable=True),
        sa.Column("pixel_area_amodal", sa.Integer(), nullable=True),
        sa.Column("undefined_reason", sa.String(length=64), nullable=True),
        sa.ForeignKeyConstraint(["truth"], ["products.digest"], name=op.f("fk_person_views_truth"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("truth", "instance_id", name=op.f("pk_person_views")),
    )
    op.create_table(
        "pictures",
        sa.Column("prediction", sa.String(length=32), nullable=False),
        sa.Column("picture_mean", sa.Float(), nullable=True),
        sa.Column("picture_deviation", sa.Float(), nullable=True),
        sa.Column("black_share", sa.Float(), nullable=True),
        sa.Column("white_share", sa.Float(), nullable=True),
        sa.ForeignKeyConstraint(
            ["prediction"], ["products.digest"], name=op.f("fk_pictures_prediction"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("prediction", name=op.f("pk_pictures")),
    )
    op.create_table(
        "scores",
        sa.Column("digest", sa.String(length=32), nullable=False),
        sa.Column("confusion", sa.LargeBinary(), nullable=False),
        sa.Column("tp", sa.Integer(), nullable=False),
        sa.Column("fn", sa.Integer(), nullable=False),
        sa.Column("tn", sa.Integer(), nullable=False),
        sa.Column("pacc", sa.Float(), nullable=True),
        sa.Column("precision", sa.Float(), nullable=True),
        sa.Column("iou", sa.Float(), nullable=True),
        sa.Column("pixel_accuracy", sa.Float(), nullable=True),
        sa.Column("miou", sa.Float(), nullable=True),
        sa.Column("fwiou", sa.Float(), nullable=True),
        sa.Column("macc", sa.Float(), nullable=True),
        sa.Column("fp", sa.Integer(), nullable=False),
        sa.ForeignKeyConstraint(["digest"], ["products.digest"], name=op.f("fk_scores_digest"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("digest", name=op.f("pk_scores")),
    )
    op.create_table(
        "variants",
        sa.Column("run_id", sa.String(length=32), nullable=False),
        sa.Column("index", sa.BigInteger(), nullable=False),
        sa.Column("block", sa.Integer(), nullable=False),
        sa.Column("assignment", DOCUMENT, nullable=False),
        sa.Column("rejection", sa.Text(), nullable=True),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_variants_run_id"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("run_id", "index", name=op.f("pk_variants")),
    )
    op.create_table(
        "frames",
        sa.Column("run_id", sa.String(length=32), nullable=False),
        sa.Column("variant_index", sa.BigInteger(), nullable=False),
        sa.Column("camera_index", sa.Integer(), nullable=False),
        sa.Column("time_index", sa.Integer(), nullable=False),
        sa.Column("background", sa.String(length=32), nullable=False),
        sa.Column("layer", sa.String(length=32), nullable=False),
        sa.Column("truth", sa.String(length=32), nullable=False),
        sa.ForeignKeyConstraint(
            ["run_id", "variant_index"],
            ["variants.run_id", "variants.index"],
            name="fk_frames_variant",
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("run_id", "variant_index", "camera_index", "time_index", name=op.f("pk_frames")),
    )
    with op.batch_alter_table("frames", schema=None) as batch_op:
        batch_op.create_index("ix_frames_background", ["background"], unique=False)
        batch_op.create_index("ix_frames_layer", ["layer"], unique=False)
        batch_op.create_index("ix_frames_truth", ["truth"], unique=False)

    op.create_table(
        "evaluations",
        sa.Column("run_id", sa.String(length=32), nullable=False),
        sa.Column("variant_index", sa.BigInteger(), nullable=False),
        sa.Column("camera_index", sa.Integer(), nullable=False),
        sa.Column("time_index", sa.Integer(), nullable=False),
        sa.Column("sensor_index", sa.Integer(), nullable=False),
        sa.Column("function_index", sa.Integer(), nullable=False),
        sa.Column("prediction", sa.String(length=32), nullable=False),
        sa.Column("scores", sa.String(length=32), nullable=False),
        sa.Column("empty", sa.String(length=32), nullable=True),
        sa.Column("distorted", sa.Boolean(), nullable=False),
        sa.ForeignKeyConstraint(
            ["run_id", "variant_index", "camera_index", "time_index"],
            ["frames.run_id", "frames.variant_index", "frames.camera_index", "frames.time_index"],
            name="fk_evaluations_frame",
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint(
            "run_id",
            "variant_index",
            "camera_index",
            "time_index",
            "sensor_index",
            "function_index",
            name=op.f("pk_evaluations"),
        ),
    )
    with op.batch_alter_table("evaluations", schema=None) as batch_op:
        batch_op.create_index("ix_evaluations_prediction", ["prediction"], unique=False)
        batch_op.create_index("ix_evaluations_scores", ["scores"], unique=False)
        batch_op.create_index("ix_evaluations_empty", ["empty"], unique=False)

    op.create_table(
        "frame_annotations",
        sa.Column("run_id", sa.String(length=32), nullable=False),
        sa.Column("variant_index", sa.BigInteger(), nullable=False),
        sa.Column("camera_index", sa.Integer(), nullable=False),
        sa.Column("time_index", sa.Integer(), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("product", sa.String(length=32), nullable=False),
        sa.ForeignKeyConstraint(
            ["run_id", "variant_index", "camera_index", "time_index"],
            ["frames.run_id", "frames.variant_index", "frames.camera_index", "frames.time_index"],
            name="fk_frame_annotations_frame",
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint(
            "run_id", "variant_index", "camera_index", "time_index", "kind", name=op.f("pk_frame_annotations")
        ),
    )
    with op.batch_alter_table("frame_annotations", schema=None) as batch_op:
        batch_op.create_index("ix_frame_annotations_product", ["product"], unique=False)

    op.create_table(
        "study_batches",
        sa.Column("study_id", sa.String(length=32), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("count", sa.Integer(), nullable=False),
        sa.Column("points", DOCUMENT, nullable=False),
        sa.Column("rejected", DOCUMENT, nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("basis", sa.String(length=32), nullable=False),
        sa.Column("based_on", sa.Integer(), nullable=False),
        sa.Column("accepted_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("run_id", sa.String(length=32), nullable=True),
        sa.Column("retries", sa.Integer(), nullable=False),
        sa.Column("outcomes", DOCUMENT, nullable=True),
        sa.Column("cpu_seconds", sa.Float(), nullable=True),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_study_batches_run_id"), ondelete="SET NULL"),
        sa.ForeignKeyConstraint(
            ["study_id"], ["studies.id"], name=op.f("fk_study_batches_study_id"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("study_id", "number", name=op.f("pk_study_batches")),
    )
    with op.batch_alter_table("study_batches", schema=None) as batch_op:
        batch_op.create_index("ix_study_batches_run_id", ["run_id"], unique=False)

    op.create_table(
        "tokens",
        sa.Column("name", sa.String(length=64), nullable=False),
        sa.Column("digest", sa.String(length=64), nullable=False),
        sa.Column("owner", sa.String(length=200), nullable=False),
        sa.Column("role", sa.String(length=16), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("expires_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("revoked_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("used_at", sa.DateTime(timezone=True), nullable=True),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_tokens")),
        sa.UniqueConstraint("digest", name=op.f("uq_tokens_digest")),
    )
    op.create_table(
        "deliveries",
        sa.Column("run_id", sa.String(length=32), nullable=False),
        sa.Column("ended_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("receiver", sa.String(length=64), nullable=False),
        sa.Column("attempts", sa.Integer(), nullable=False),
        sa.Column("due_at", sa.Float(), nullable=True),
        sa.Column("problem", sa.Text(), nullable=True),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_deliveries_run_id"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("run_id", "ended_at", "receiver", name=op.f("pk_deliveries")),
    )
    op.create_table(
        "audit",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("request", sa.String(length=16), nullable=False),
        sa.Column("at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("caller", sa.String(length=64), nullable=True),
        sa.Column("owner", sa.String(length=200), nullable=True),
        sa.Column("role", sa.String(length=16), nullable=True),
        sa.Column("address", sa.String(length=64), nullable=False),
        sa.Column("method", sa.String(length=16), nullable=False),
        sa.Column("path", sa.String(length=1000), nullable=False),
        sa.Column("status", sa.Integer(), nullable=True),
        sa.Column("left_out", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_audit")),
    )
    if op.get_bind().dialect.name == "postgresql":
        op.execute(
            "CREATE FUNCTION refuse_audit_change() RETURNS trigger LANGUAGE plpgsql AS "
            f"$$ BEGIN RAISE EXCEPTION '{_AUDIT_REFUSAL}'; END $$"
        )
        op.execute(
            "CREATE TRIGGER audit_is_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON audit "
            "FOR EACH STATEMENT EXECUTE FUNCTION refuse_audit_change()"
        )
    else:
        for event in ("UPDATE", "DELETE"):
            op.execute(
                f"CREATE TRIGGER audit_refuses_{event.lower()} BEFORE {event} ON audit "
                f"BEGIN SELECT RAISE(ABORT, '{_AUDIT_REFUSAL}'); END"
            )
