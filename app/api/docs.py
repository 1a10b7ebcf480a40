"""`/api/docs`: the interface as one plain page made from its OpenAPI description, without any script."""

from __future__ import annotations

import json
from html import escape
from typing import Any

STYLE = """
body { margin: 0 auto; max-width: 60rem; padding: 2rem 1.25rem 5rem; background: #14181b;
  color: #e8e6e1; font: 15px/1.55 system-ui, sans-serif }
h1 { font-size: 1.5rem }
h2 { margin-top: 2.2rem; font-size: 1.1rem; text-transform: capitalize; color: #8fd3c4 }
a { color: #8fd3c4 } p, li { color: #c3c4be }
details { border-top: 1px solid #2b3236; padding: .45rem 0 } summary { cursor: pointer }
code, pre { font: 13px/1.5 ui-monospace, monospace }
pre { overflow: auto; padding: .8rem; background: #1d2326; border-radius: 6px; max-height: 24rem }
.verb { display: inline-block; width: 4.2rem; color: #f0a35e } .gist { color: #a9aca8 }
"""


def page(schema: dict[str, Any]) -> str:
    """The whole page for an OpenAPI document."""
    groups: dict[str, list[str]] = {}
    for path, operations in schema["paths"].items():
        for verb, operation in operations.items():
            group = operation.get("tags", ["studio"])[0]
            groups.setdefault(group, []).append(_operation(path, verb, operation))
    body = "".join(f"<h2>{escape(name)}</h2>{''.join(entries)}" for name, entries in sorted(groups.items()))
    schemas = schema.get("components", {}).get("schemas", {})
    models = "".join(_model(name, model) for name, model in schemas.items())
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
        f"<title>{escape(schema['info']['title'])}: interface</title><style>{STYLE}</style></head><body>"
        f"<h1>{escape(schema['info']['title'])}: interface</h1>{_introduction()}{body}"
        f"<h2>Documents</h2>{models}</body></html>"
    )


def _introduction() -> str:
    return (
        "<p>Send the token as <code>Authorization: Bearer TOKEN</code>. Metres, seconds and degrees; x "
        'points east, y north. Errors are <code>{"detail": "what was wrong and what would be right"}</code>. '
        "<code>WS /api/stream</code> sends the mission as JSON, at most ten times a second. "
        'The same in machine-readable form: <a href="/api/openapi.json">openapi.json</a>. '
        '<a href="/">Back to the studio</a></p>'
    )


def _operation(path: str, verb: str, operation: dict[str, Any]) -> str:
    gist = operation.get("description") or operation.get("summary", "")
    parameters = "".join(
        f"<li><code>{escape(item['name'])}</code> in the {item['in']}: {_kind(item.get('schema', {}))}</li>"
        for item in operation.get("parameters", [])
    )
    body = "".join(
        f"<li>body, <code>{escape(kind)}</code>: {_kind(content.get('schema', {}))}</li>"
        for kind, content in operation.get("requestBody", {}).get("content", {}).items()
    )
    answers = "".join(
        f"<li>{escape(status)}: {_kind(content.get('schema', {}))}</li>"
        for status, answer in operation.get("responses", {}).items()
        for content in answer.get("content", {}).values()
        if status.startswith("2")
    )
    return (
        f'<details><summary><code><span class="verb">{verb.upper()}</span>{escape(path)}</code> '
        f'<span class="gist">{escape(gist)}</span></summary><ul>{parameters}{body}{answers}</ul></details>'
    )


def _kind(schema: dict[str, Any]) -> str:
    """A short name for a schema, linked where it is one of the documents."""
    reference = schema.get("$ref", "").rpartition("/")[2]
    if reference:
        return f'<a href="#{escape(reference)}">{escape(reference)}</a>'
    if schema.get("type") == "array":
        return f"list of {_kind(schema.get('items', {}))}"
    return f"<code>{escape(json.dumps(schema, ensure_ascii=False)[:400])}</code>" if schema else "anything"


def _model(name: str, model: dict[str, Any]) -> str:
    text = json.dumps(model, indent=2, ensure_ascii=False)
    summary = f"<summary><code>{escape(name)}</code></summary>"
    return f'<details id="{escape(name)}">{summary}<pre>{escape(text)}</pre></details>'
