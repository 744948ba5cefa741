-- One role per stage, which reads and writes no more than its workers need. Run it as the owner of the tables, who may create
-- roles, after each `valerie migrate` and `valerie restore`; then give each role a password (\password valerie_render), and the
-- API the owner's account.
--
--   psql "$VALERIE_DATABASE_URL" --file deploy/postgres/roles.sql

DO $$
DECLARE
  role text;
BEGIN
  FOREACH role IN ARRAY ARRAY['valerie_worker', 'valerie_render', 'valerie_infer', 'valerie_eval'] LOOP
    IF NOT EXISTS (SELECT FROM pg_roles WHERE rolname = role) THEN
      EXECUTE format('CREATE ROLE %I LOGIN', role);
    END IF;
  END LOOP;
END $$;
ALTER ROLE valerie_worker NOLOGIN;
GRANT valerie_worker TO valerie_render, valerie_infer, valerie_eval;

-- All stages: what to make, whether somebody wants it, and signs of life.
REVOKE CREATE ON SCHEMA public FROM PUBLIC;  -- before Postgres 15
GRANT USAGE ON SCHEMA public TO valerie_worker;
GRANT SELECT ON alembic_version, runs, variants, products, frames, evaluations, frame_annotations, functions,
  person_views, person_lights, pictures, scores, person_scores TO valerie_worker;
GRANT SELECT, INSERT, UPDATE, DELETE ON workers TO valerie_worker;
GRANT SELECT, INSERT, DELETE ON specimens TO valerie_worker;
GRANT SELECT, INSERT, UPDATE ON owner_turns TO valerie_worker;
GRANT UPDATE ON products TO valerie_worker;
GRANT UPDATE (state, reason) ON runs TO valerie_worker;  -- a full store pauses runs

-- What each stage measures. A product that is made again replaces its rows.
GRANT INSERT, UPDATE, DELETE ON person_views, person_lights TO valerie_render;
GRANT INSERT ON products TO valerie_render;  -- of the statics that truths share
GRANT INSERT, UPDATE, DELETE ON pictures TO valerie_infer;
GRANT INSERT, UPDATE, DELETE ON scores, person_scores TO valerie_eval;

-- Evaluation also ends runs, and removes what they do not keep.
GRANT UPDATE (finished_at) ON runs TO valerie_eval;
GRANT UPDATE (removed) ON frames TO valerie_eval;
GRANT SELECT, INSERT, UPDATE, DELETE ON leases TO valerie_eval;
