"""An mdBook preprocessor: puts the API's reference, made from openapi/openapi.json, where a chapter says {{#api}}.

mdBook asks `supports RENDERER` first, then sends [context, book] as JSON and takes the book back."""

import json
import re
import sys
from pathlib import Path

DOCUMENT = json.loads((Path(__file__).parents[1] / "openapi" / "openapi.json").read_text())
SCHEMAS = DOCUMENT["components"]["schemas"]
METHODS = ("get", "post", "put", "patch", "delete")
TAGS = {"jobs": "Jobs", "maps": "Maps", "places": "Places", "webhooks": "Webhooks", "service": "The service"}


def cell(text: str | None) -> str:
    """Text as a table's cell has it."""
    return " ".join((text or "").split()).replace("|", "\\|").replace("<", "&lt;")


def limits(schema: dict) -> str:
    """What a value is held to."""
    low, high = schema.get("minimum", schema.get("minLength")), schema.get("maximum", schema.get("maxLength"))
    span = [f"from {low:,}"] if low else []
    span += [f"up to {high:,}"] if high is not None else []
    default = [f"{json.dumps(schema['default'])} by default"] if "default" in schema else []
    return ", ".join(span + default)


def kind(schema: dict) -> str:
    """A schema in a word or two."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#schema-{name.lower()})"
    if "enum" in schema:
        return " or ".join(f"`{json.dumps(value)}`" for value in schema["enum"])
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    for several in ("oneOf", "anyOf", "allOf"):
        if several in schema:
            kinds = [kind(one) for one in schema[several] if one.get("type") != "null"]
            return " or ".join(dict.fromkeys(kinds)) or "null"
    names = schema.get("type", "anything")
    names = [name for name in (names if isinstance(names, list) else [names]) if name != "null"]
    if names == ["array"]:
        return f"array of {kind(schema.get('items') or {})}"
    if names == ["object"] and isinstance(schema.get("additionalProperties"), dict):
        return f"object of {kind(schema['additionalProperties'])}"
    pattern = re.fullmatch(r"\^\(([\w|-]+)\)\$", schema.get("pattern", ""))
    if pattern:
        return " or ".join(f"`{word}`" for word in pattern[1].split("|"))
    return " or ".join(names)


def described(schema: dict) -> str:
    """A field's words, of its own or of what it refers to."""
    inner = [one.get("description", "") for one in schema.get("oneOf", []) if one.get("type") != "null"]
    return cell(" ".join(filter(None, [schema.get("description", ""), *inner])))


def operation(method: str, path: str, told: dict) -> list[str]:
    """A route."""
    lines = [f"#### `{method.upper()} {path}`", "", cell(told.get("summary")), ""]
    if told.get("description"):
        lines += [told["description"], ""]
    scopes = [scope for need in told.get("security", []) for scopes in need.values() for scope in scopes]
    if scopes:
        lines += [f"Needs the scope `{'`, `'.join(scopes)}` where keys are in use.", ""]
    if told.get("parameters"):
        lines += ["| parameter | in | what |", "| --- | --- | --- |"]
        for parameter in told["parameters"]:
            must = ", required" if parameter.get("required") and parameter["in"] != "path" else ""
            words = [
                kind(parameter.get("schema", {})),
                limits(parameter.get("schema", {})),
                cell(parameter.get("description")),
            ]
            lines.append(f"| `{parameter['name']}` | {parameter['in']}{must} | {'; '.join(filter(None, words))} |")
        lines.append("")
    body = told.get("requestBody")
    if body:
        kinds = ", ".join(f"`{media}`: {kind(content.get('schema', {}))}" for media, content in body["content"].items())
        words = cell(body.get("description"))
        lines += [f"Body: {kinds}{f' ({words})' if words else ''}.", ""]
    lines += ["| answer | what | as |", "| --- | --- | --- |"]
    for status, answer in told["responses"].items():
        if status in ("4XX", "5XX"):
            continue
        kinds = ", ".join(
            f"`{media}`: {kind(content.get('schema', {}))}" for media, content in answer.get("content", {}).items()
        )
        lines.append(f"| {status} | {cell(answer.get('description'))} | {kinds} |")
    return [*lines, ""]


def schema_of(name: str) -> list[str]:
    """A schema of the document."""
    schema = SCHEMAS[name]
    lines = [f'<h4 id="schema-{name.lower()}">{name}</h4>', "", schema.get("description", ""), ""]
    if not schema.get("properties"):
        return [*lines, kind(schema), ""]
    required = schema.get("required", [])
    lines += ["| field | what | |", "| --- | --- | --- |"]
    for field, told in schema["properties"].items():
        words = "; ".join(filter(None, [limits(told), described(told)]))
        lines.append(f"| `{field}`{'' if field in required else ' (optional)'} | {kind(told)} | {words} |")
    return [*lines, ""]


def page() -> str:
    """The whole reference."""
    lines = []
    for tag, title in TAGS.items():
        lines += [f"## {title}", ""]
        for path, methods in DOCUMENT["paths"].items():
            for method in METHODS:
                if method in methods and methods[method]["tags"] == [tag]:
                    lines += operation(method, path, methods[method])
    lines += ["## Schemas", "", "Fields that are not optional are always there.", ""]
    for name in sorted(SCHEMAS):
        lines += schema_of(name)
    return "\n".join(lines)


def filled(items: list) -> None:
    """Chapters, and those within them, with the reference where they ask for it."""
    for item in items:
        if isinstance(item, dict) and "Chapter" in item:
            chapter = item["Chapter"]
            if "{{#api}}" in chapter["content"]:
                chapter["content"] = chapter["content"].replace("{{#api}}", page())
            filled(chapter["sub_items"])


def main() -> int:
    if len(sys.argv) > 1 and sys.argv[1] == "supports":
        return 0
    _, book = json.load(sys.stdin)
    filled(book.get("items") or book.get("sections"))
    json.dump(book, sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
