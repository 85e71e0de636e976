#!/usr/bin/env python3
"""Writes docs/reference.md from the help texts and schemas of the program and of `sizeup-lab`, which lies beside it.

Usage: tools/reference.py PROGRAM > docs/reference.md
"""
import json
import pathlib
import re
import subprocess
import sys
from dataclasses import dataclass

COMMANDS = ["init", "run", "footprints", "survey inspect", "survey align", "survey convert", "survey dtm"]
COMMANDS += ["model list", "model get", "model check", "model inspect", "model compute"]
COMMANDS += ["evaluate", "changes"]
COMMANDS += ["texture", "view", "tiles plan", "tiles run", "tiles merge", "tiles status", "check", "export", "demo", "schema", "completions"]
OF_LAB = ["simulate", "baseline", "benchmark"]
PROGRAM = sys.argv[1]
LAB = str(pathlib.Path(PROGRAM).with_name("sizeup-lab"))


def say(*arguments, program=PROGRAM):
    done = subprocess.run([program, *arguments], capture_output=True, text=True, check=True, env={"COLUMNS": "100"})
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


def sub_tables(path, field, defs):
    """The tables below a key: itself, or one for each `source`; each with its name in the schema, its keys and what to say of it."""
    variants = [v for v in field.get("oneOf", []) if "source" in v.get("properties", {})]
    for variant in variants:
        full = resolved(variant, defs)
        keys = {**full.get("properties", {}), **variant["properties"]}
        source = keys.pop("source")["const"]
        head = f'with `source = "{source}"`: {text(variant)}'
        required = set(full.get("required", [])) | set(variant.get("required", []))
        yield Table(path, named_as(keys, defs) or f"{path}/{source}", keys, required, {}, is_expert(full, is_expert(field, False)), head)
    if not variants and "properties" in field:
        defaults = field.get("default") or {}
        yield Table(path, field["ref"], field["properties"], set(field.get("required", [])), defaults, field["x-expert"], text(field))


@dataclass
class Table:
    """A table of a configuration."""

    path: str
    ref: str
    keys: dict
    required: set
    defaults: dict
    expert: bool
    head: str

    @property
    def title(self):
        return f"[{self.path}]" if self.path else "Top level"

    def fields(self, defs):
        """Each key with what is known of it, defaults and marks of the table included."""
        for key, raw in self.keys.items():
            field = resolved(raw, defs)
            field["ref"] = ref_of(raw) or f"{self.ref}/{key}"
            field["x-expert"] = is_expert(field, self.expert)
            if self.defaults and key in self.defaults:
                field["default"] = self.defaults[key]
            yield key, f"{self.path}.{key}" if self.path else key, field

    def below(self, defs):
        """The tables in this one."""
        return [table for _, path, field in self.fields(defs) for table in sub_tables(path, field, defs)]


def named_as(keys, defs):
    """The structure that has these keys, where one does: the schema writes variants out."""
    return next((f"#/$defs/{name}" for name, schema in defs.items() if set(schema.get("properties", {})) == set(keys)), None)


def ref_of(raw):
    """The name in the schema of what a key holds, where it has one."""
    options = [s for s in raw.get("anyOf", []) if s.get("type") != "null"]
    return raw.get("$ref") or (options[0].get("$ref") if len(options) == 1 else None)


def is_expert(schema, around):
    """Whether a key or table is for experts: as it says itself, else as what it lies in."""
    return schema.get("x-expert", around)


def all_tables(root, defs):
    """A table and all below it, in order."""
    found = [root]
    for table in root.below(defs):
        found += all_tables(table, defs)
    return found


def row(key, field, defs, required):
    words = "<br>".join(f"`{w}`: {t}" if t else f"`{w}`" for w, t in choices(field))
    meaning = text(field) + (f"<br>{words}" if words else "")
    return f"| `{key}` | {kind(field, defs)} | {default(field, key in required)} | {meaning} |"


def tables(root, defs, wants_expert):
    """The tables with the keys that are for experts, or with those that are not; what occurs in several places once."""
    everything = all_tables(root, defs)
    # What occurs several times is written where its path is shortest.
    first = {}
    for table in sorted(everything, key=lambda t: t.path.count(".")):
        first.setdefault(table.ref, table)
    is_first = lambda table: (first[table.ref].path, first[table.ref].head) == (table.path, table.head)
    written = set()
    for table in everything:
        if not is_first(table) or table.ref in written:
            continue
        written.add(table.ref)
        rows, others = [], []
        for key, path, field in table.fields(defs):
            below = list(sub_tables(path, field, defs))
            again = [t for t in below if not is_first(t)]
            if below and not again:
                continue
            if field["x-expert"] != wants_expert:
                others += [] if below else [key]
            elif below:
                rows.append(f"| `{key}` | table | {default(field, key in table.required)} | {text(field)} Keys as in {place(first[again[0].ref])}. |")
            else:
                rows.append(row(key, field, defs, table.required))
        if rows:
            print(f"### {table.title}\n\n{table.head}".rstrip() + "\n")
            print("| key | type | default | meaning |\n|---|---|---|---|")
            print("\n".join(rows) + "\n")
            if others and not wants_expert:
                print(f"For experts: {', '.join(f'`{key}`' for key in others)}.\n")


def place(table):
    source = re.match(r"with (`source = .*?`)", table.head)
    return f"`{table.title}`" + (f" with {source[1]}" if source else "")


def settings(of, schema, shown_by):
    schema = json.loads(schema)
    defs = schema.get("$defs", {})
    root = Table("", "", schema["properties"], set(schema.get("required", [])), {}, False, "")
    print(f"## {of}\n")
    print(f"The same as JSON Schema, for editors: `{shown_by}`. `–`: not set unless you set it.\n")
    tables(root, defs, False)
    if any(field["x-expert"] for table in all_tables(root, defs) for _, _, field in table.fields(defs)):
        print(f"## Expert settings: {of[0].lower()}{of[1:]}\n")
        print("Thresholds, weights and forms of files that are rare. They stand in the same tables as the keys above, and no run needs them.\n")
        tables(root, defs, True)


print("# Reference\n\nWritten by `make docs` from the program itself; do not edit.\n\n## Commands\n")
print(f"```\n{say('--help')}\n```\n")
for command in COMMANDS:
    print(f"### sizeup {command}\n\n```\n{say(*command.split(), '--help')}\n```\n")
print(f"## Commands of the laboratory\n\nA program of its own, `sizeup-lab`: `cargo build --release --workspace` builds it.\n")
print(f"```\n{say('--help', program=LAB)}\n```\n")
for command in OF_LAB:
    print(f"### sizeup-lab {command}\n\n```\n{say(command, '--help', program=LAB)}\n```\n")
settings("Configuration of `sizeup run`", say("schema", "run"), "sizeup schema run")
for network in ["depth", "footprint"]:
    settings(f"Profile of a {network} network", say("schema", f"{network}-network"), f"sizeup schema {network}-network")
settings("Configuration of `sizeup-lab simulate`", say("schema", program=LAB), "sizeup-lab schema")
