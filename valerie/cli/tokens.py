"""Commands that issue, list and revoke tokens of the API in the database of the deployment, and that show quotas."""

from __future__ import annotations

import json
from dataclasses import asdict
from datetime import datetime
from typing import Annotated

import typer

from valerie.cli.shell import AsJson, DataDir, Url, print_json, recorded, say
from valerie.local.deployment import context_of

app = typer.Typer(no_args_is_help=True, help="Manage tokens of the API, each with an owner and a role.")
_Name = Annotated[str, typer.Argument(metavar="NAME", help="Name of the token.")]


@app.command()
def create(
    name: _Name,
    owner: Annotated[str, typer.Option("--owner", help="Person or service that holds it.")],
    role: Annotated[str, typer.Option("--role", metavar="viewer|runner|admin", help="Its rights.")] = "viewer",
    project: Annotated[
        str, typer.Option("--project", help="The only project that it sees; a new name begins one. Default: all.")
    ] = "",
    scope: Annotated[
        list[str] | None,
        typer.Option("--scope", metavar="AREA", help="An area of the API that it reaches; repeatable. Default: all."),
    ] = None,
    days: Annotated[int, typer.Option("--days", help="Days until it expires, at most 3650.")] = 90,
    data_dir: DataDir = None,
) -> None:
    """Issue a token and print its secret, which is stored nowhere and cannot be shown again.

    A server accepts it if VALERIE_API_TOKEN is set; without that, a server needs no token.
    """
    from pydantic import ValidationError

    from valerie.pipeline.control.tokens import TokenRequest, issue
    from valerie.validation import problems_of

    try:
        request = TokenRequest.model_validate(
            {"name": name, "owner": owner, "role": role, "project": project, "scopes": scope or (), "days": days}
        )
    except ValidationError as error:
        raise problems_of(error) from None
    with context_of(data_dir) as context, recorded(context, f"token create {name}"):
        _, secret = issue(context, request)
    typer.echo(secret)


@app.command("list")
def list_tokens(as_json: AsJson = False, data_dir: DataDir = None) -> None:
    """List all tokens, with those that expired or were revoked; without secrets."""
    from valerie.db import tokens
    from valerie.db.engine import reading
    from valerie.runs.moments import moment_text

    with context_of(data_dir) as context, reading(context.engine) as connection:
        rows = tokens.listed(connection)
    for row in rows:
        if as_json:
            typer.echo(json.dumps(asdict(row), default=datetime.isoformat, ensure_ascii=False))
        else:
            end = (
                f"revoked {moment_text(row.revoked_at)}" if row.revoked_at else f"expires {moment_text(row.expires_at)}"
            )
            used = f"used {moment_text(row.used_at)}" if row.used_at else "never used"
            project = f" in {row.project}" if row.project else ""
            scopes = f", only {', '.join(row.scopes)}" if row.scopes else ""
            typer.echo(f"{row.name:<24} {row.role:<7} {end}, {used}: {row.owner}{project}{scopes}")


@app.command()
def revoke(name: _Name, data_dir: DataDir = None) -> None:
    """Revoke a token at once."""
    from valerie.pipeline.control.tokens import revoke as revoke_token

    with context_of(data_dir) as context, recorded(context, f"token revoke {name}"):
        revoke_token(context, name)
    typer.echo(f"revoked: {name}")


def quota(as_json: AsJson = False, url: Url = None, data_dir: DataDir = None) -> None:
    """Show what counts for the quotas of your token and its project; for the operator all quotas.

    The operator sets them: docs/operations.md#quotas.
    """
    from valerie.cli.connecting import source_of

    with source_of(data_dir, url) as source:
        quotas = source.quotas()
    if as_json:
        print_json([quota.model_dump() for quota in quotas])
        return
    if not quotas:
        say("no quotas")
    for each in quotas:
        digits = 0 if each.resource in ("runs", "variants") else 2
        ahead = f", {each.forecast:,.{digits}f} forecast for unfinished runs" if each.forecast else ""
        typer.echo(f"{each.holder:<24} {each.resource:<9} {each.used:,.{digits}f} of {each.limit:,.{digits}f}{ahead}")
