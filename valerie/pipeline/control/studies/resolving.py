"""Resolve studies against the assets and functions of a deployment."""

from __future__ import annotations

from valerie.db.engine import reading
from valerie.db.studies import StudyRow
from valerie.errors import Conflict, InvalidInput
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_new
from valerie.pipeline.functions import registry
from valerie.runs.document.run_spec import RunSpec
from valerie.runs.study.study_document import CascadeGoal, StudyDocument
from valerie.studies.resolved import ResolvedStudy, resolve_study


def resolve_document(context: Context, document: StudyDocument) -> ResolvedStudy:
    """Resolve and fully check a study.

    Raises:
        InvalidInput: an unknown name, a bound, a size: with field, value and limit.
    """
    with reading(context.engine) as connection:
        names = registry.names(connection, registry.known(connection, document.spec.functions))
    if isinstance(document.goal, CascadeGoal):
        costly = document.spec.model_copy(update={"renderer": document.goal.renderer})
        try:
            resolve_new(RunSpec.model_validate(costly.model_dump()), context.settings, registered=names)
        except InvalidInput as problem:
            raise InvalidInput(f"by the costly engine: {problem}", field="goal.renderer") from None
    return resolve_study(document, resolve_new(document.spec, context.settings, registered=names))


def resolve_row(context: Context, study: StudyRow) -> ResolvedStudy:
    """Resolve a stored study.

    Raises:
        Conflict: its asset changed.
        InvalidInput: it names something that no longer exists.
    """
    resolved = resolve_document(context, study.document)
    if resolved.run.asset_digest != study.asset_digest:
        raise Conflict(f"the asset {resolved.run.manifest.name!r} changed since the study began: start the study again")
    return resolved
