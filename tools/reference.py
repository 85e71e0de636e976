#!/usr/bin/env python3
"""Writes docs/reference.md from what the program says of itself: its --help and its schemas.

Usage: tools/reference.py PROGRAM > docs/reference.md
"""
import json
import subprocess
import sys

COMMANDS = ["init", "run", "footprints", "dtm", "survey inspect", "survey align", "survey convert", "prior inspect", "prior compute"]
COMMANDS += ["evaluate", "changes", "baseline"]
COMMANDS += ["look", "view", "benchmark", "tiles plan", "tiles run", "tiles merge", "tiles status", "validate", "export", "simulate", "demo", "schema", "completions"]


def say(*arguments):
    done = subprocess.run([sys.argv[1], *arguments], capture_output=True, text=True, check=True, env={"COLUMNS": "100"})
    return done.stdout.rstrip()


def text(schema):
    return " ".join(schema.get("description", "").split()).replace("|", "\\|")


def resolved(schema, defs):
    """What a schema refers to; a description beside the reference goes before that of its target."""
    options = [s for s in schema.get("anyOf", []) if s.get("type") != "null"]
    if len(options) == 1:
        schema = {**options[0], **{k: v for k, v in schema.items() if k != "anyOf"}}
    if "$ref" in schema:
        schema = {**defs[schema["$ref"].rsplit("/", 1)[1]], **{k: v for k, v in schema.items() if k != "$ref"}}
    return schema


def choices(schema):
    """The words of an enumeration, each with its meaning."""
    found = [(word, "") for word in schema.get("enum", []) if word is not None]
    for option in schema.get("oneOf", []):
        if "const" in option:
            found.append((option["const"], text(option)))
        elif option.get("enum"):
            found += [(word, text(option)) for word in option["enum"]]
        elif len(option.get("properties", {})) == 1:
            found.append((f"{{ {next(iter(option['properties']))} = … }}", text(option)))
    return found


def kind(schema, defs):
    if choices(schema):
        return "one of"
    of = schema.get("type", "value")
    of = next((t for t in of if t != "null"), "value") if isinstance(of, list) else of
    if of == "array":
        length = f" of {schema['maxItems']}" if "maxItems" in schema else ""
        return f"list{length}"
    return {"string": "text", "integer": "whole number", "boolean": "true or false", "object": "table"}.get(of, of)


def default(schema, required):
    if required:
        return "**required**"
    value = schema.get("default")
    if isinstance(value, float):
        value = float(f"{value:.7g}")  # single-precision settings are written with all their digits
    return "–" if value is None else f"`{json.dumps(value, ensure_ascii=False)}`"


def table(name, schema, defs, defaults=None, head=None):
    """Rows for the plain keys of a table, then its sub-tables."""
    rows, below = [], []
    for key, raw in schema.get("properties", {}).items():
        field = resolved(raw, defs)
        if defaults and key in defaults:
            field = {**field, "default": defaults[key]}
        path = f"{name}.{key}" if name else key
        variants = [v for v in field.get("oneOf", []) if "source" in v.get("properties", {})]
        if variants:
            for variant in variants:
                full = resolved(variant, defs)
                merged = {**full, **variant, "properties": {**full.get("properties", {}), **variant["properties"]}}
                source = merged["properties"].pop("source")["const"]
                below.append((path, merged, None, f'with `source = "{source}"`: {text(variant)}'))
        elif "properties" in field:
            below.append((path, field, field.get("default"), text(field)))
        else:
            words = "<br>".join(f"`{w}`: {t}" if t else f"`{w}`" for w, t in choices(field))
            meaning = text(field) + (f"<br>{words}" if words else "")
            rows.append(f"| `{key}` | {kind(field, defs)} | {default(field, key in schema.get('required', []))} | {meaning} |")
    if rows:
        print(f"### {f'[{name}]' if name else 'Top level'}\n")
        if head:
            print(f"{head}\n")
        print("| key | type | default | meaning |\n|---|---|---|---|")
        print("\n".join(rows) + "\n")
    for part in below:
        table(part[0], part[1], defs, part[2], part[3])


print("# Reference\n\nWritten by `make docs` from the program itself; do not edit.\n\n## Commands\n")
print(f"```\n{say('--help')}\n```\n")
for command in COMMANDS:
    print(f"### sizeup {command}\n\n```\n{say(*command.split(), '--help')}\n```\n")
for which in ["run", "simulate"]:
    schema = json.loads(say("schema", which))
    print(f"## Configuration of `sizeup {which}`\n")
    print("The same as JSON Schema, for editors: " f"`sizeup schema {which}`. `–`: not set unless you set it.\n")
    table("", schema, schema.get("$defs", {}))
