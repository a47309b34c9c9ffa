#!/usr/bin/env python3
"""Writes the man pages curlew.1.gz and curlew.toml.5.gz: man_pages.py PROGRAM FOLDER

The pages are man/curlew.1 and man/curlew.toml.5 beside this script. In them @COMMANDS@ stands for
what PROGRAM says of its commands at --help, @SETTINGS@ for what curlew.toml says of its settings,
@VERSION@ for what PROGRAM says at --version. What cannot be understood is an error, so that nothing
is left out in silence.
"""
import os
import pathlib
import re
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
HELP_COLUMN = 30  # where CLI11 begins descriptions


class NotUnderstood(Exception):
    pass


# Troff.


def escaped(text):
    """The text itself, in troff; every hyphen is one that can be copied into a shell."""
    text = text.replace("\\", "\\e").replace("-", "\\-").replace("…", "...")
    return "\\&" + text if text[:1] in (".", "'") else text


def bold(text):
    return f"\\fB{escaped(text)}\\fR"


def italic(text):
    return f"\\fI{escaped(text)}\\fR"


def paragraph(text):
    """Prose, a line a sentence, as troff likes it. `Words` so marked are bold."""
    sentences = re.sub(r"(?<=[^A-Z ][.?!]) (?=\S)", "\n", text)
    parts = enumerate(re.split(r"`([^`]+)`", sentences))
    return "".join(
        bold(part) if i % 2 else "\n".join(map(escaped, part.split("\n"))) for i, part in parts)


# What the program says of itself.


def told(program, *arguments):
    """As it is told to anybody: the folder of one user's cache is ~/.cache."""
    run = subprocess.run(
        [program, *arguments], capture_output=True, text=True, encoding="utf-8",
        env={"HOME": "~", "LC_ALL": "C.UTF-8", "PATH": os.environ.get("PATH", "")})
    if run.returncode != 0 or run.stderr:
        raise NotUnderstood(f"{program} {' '.join(arguments)}: exit {run.returncode} {run.stderr}")
    return run.stdout


def split_columns(line, next_line):
    """Name and description; a name too long for its column has its description on the next line."""
    continued = next_line.startswith(" " * HELP_COLUMN)
    one_line = line[HELP_COLUMN - 1:HELP_COLUMN] == " " and (
        line[HELP_COLUMN - 2] == " " or not continued)
    if len(line) > HELP_COLUMN and one_line:
        return line[:HELP_COLUMN].strip(), line[HELP_COLUMN:].strip()
    return line.strip(), ""


def parse_help(text):
    """The description, the line of usage, and {heading: [(name, description)]}."""
    lines = text.splitlines()
    description, usage = lines[0], None
    sections, rows = {}, None
    for i, line in enumerate(lines[1:], 1):
        if line.startswith("Usage: "):
            usage = line[len("Usage: "):]
        elif line.startswith(" " * HELP_COLUMN) and rows:
            name, so_far = rows[-1]
            rows[-1] = (name, f"{so_far} {line.strip()}".strip())
        elif line.startswith("  ") and rows is not None:
            rows.append(split_columns(line, lines[i + 1] if i + 1 < len(lines) else ""))
        elif line.endswith(":"):
            rows = sections.setdefault(line[:-1], [])
        elif line:
            raise NotUnderstood(f"a line of --help is not understood: {line!r}")
    if usage is None:
        raise NotUnderstood(f"--help without usage: {text!r}")
    return description, usage, sections


def values_of(check, description):
    """What CLI11 says of the values an option takes, in words, where the description does not."""
    if found := re.fullmatch(r"\S+ in \[(\S+) - (\S+)\]", check):
        low, high = found.groups()
        return f"{low} or more" if float(high) > 1e15 else f"{low} to {high}"
    if found := re.fullmatch(r"(?:value in )?\{(.*?)\}(?: OR \{.*\})?", check):
        words = [word.split("->")[0] for word in found[1].split(",")]
        told_already = all(word in description for word in words)
        return "" if told_already else "one of " + ", ".join(words)
    return {"NONNEGATIVE": "0 or more", "POSITIVE": "more than 0"}.get(check, check)


def option_entry(left, description):
    """One option or positional, such as `--frames INT:INT in [1 - 9]=3 REQUIRED`."""
    facts = []
    for mark, words in ((" Excludes:", "not with "), (" Needs:", "only with ")):
        left, found, others = left.partition(mark)
        if found:
            facts.append(words + ", ".join(others.split()))
    if left.endswith(" REQUIRED"):
        left = left.removesuffix(" REQUIRED")
        facts.insert(0, "required")
    how_many = 1
    if found := re.search(r" x (\d+)$", left):
        how_many, left = int(found[1]), left[:found.start()]
    repeated = left.endswith(" ...")
    left = left.removesuffix(" ...")
    found = re.fullmatch(
        r"(?P<names>--?[\w-]+(,--?[\w-]+)*|[\w-]+)"
        r"( (?P<type>[A-Z]+)(:(?P<check>[^=]*))?(=(?P<default>.*))?)?", left)
    if not found:
        raise NotUnderstood(f"an option of --help is not understood: {left!r}")
    names, kind, check, default = found.group("names", "type", "check", "default")
    if check and (values := values_of(check, description)):
        facts.append(values)
    if default and default != "[]":
        # The default of these is what the machine has that builds the page.
        by_machine = names == "--threads" and kind == "INT"
        facts.append("default: one a CPU" if by_machine else f"default {default.strip('[]')}")
    if names.startswith("-"):
        tag = ", ".join(bold(name) for name in names.split(","))
        tag += f" {italic(kind)}" * how_many if kind else ""
    else:
        tag = italic(names)
    text = paragraph(description + (f" ({'; '.join(facts)})" if facts else ""))
    return [".TP", tag + (" ..." if repeated else ""), text]


def command_sections(program, above=()):
    """A section for each command below this one."""
    troff = []
    for name, _ in parse_help(told(program, *above, "--help"))[2].get("Subcommands", []):
        command = (*above, name)
        description, usage, sections = parse_help(told(program, *command, "--help"))
        troff += [f".SS {bold(' '.join(('curlew', *command)))}",
                  paragraph(description.rstrip(".") + "."), ".PP", bold(usage)]
        for heading, rows in sections.items():
            if heading == "Subcommands":
                continue
            if heading not in ("Positionals", "Options"):
                troff += [".PP", paragraph(heading) + ":"]
            for left, text in rows:
                if not left.startswith("-h,--help"):
                    troff += option_entry(left, text)
        troff += command_sections(program, command)
    return troff


# What the configuration says of itself.

SETTING = re.compile(r"(# )?([a-z_]+) = (.*)")


def setting_sections(file):
    """A section for each [section]. Comments, which begin with ##, belong to the settings below
    them, or to the section where an empty line follows."""
    lines = file.read_text(encoding="utf-8").splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("["))
    troff, comment, tags = [], [], []

    def finish():
        if tags and not comment:
            setting = re.sub(r"\\f.", "", tags[0])
            raise NotUnderstood(f"{file}: no comment is above the setting {setting}")
        for i, tag in enumerate(tags):
            troff.extend([".TP" if i == 0 else ".TQ", tag])
        if comment and not tags and not troff[-1].startswith(".SS"):
            troff.append(".PP")
        if comment:
            troff.append(paragraph(" ".join(comment)))
        comment.clear()
        tags.clear()

    for number, line in enumerate(lines[first:], first + 1):
        if not line:
            finish()
        elif line.startswith("["):
            finish()
            troff.append(f".SS {bold(line)}")
        elif line.startswith("## "):
            if tags:
                finish()
            comment.append(line.removeprefix("## "))
        elif found := SETTING.fullmatch(line):
            tags.append(f"{bold(found[2])} = {italic(found[3])}")
        else:
            raise NotUnderstood(f"{file}:{number} is not understood: {line}")
    finish()
    return troff


def main():
    program, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH", time.time()))
    words = {
        "@COMMANDS@": command_sections(program),
        "@SETTINGS@": setting_sections(HERE / "curlew.toml"),
        "@VERSION@": [told(program, "--version").strip()],
        "@DATE@": [time.strftime("%Y-%m-%d", time.gmtime(seconds))],
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("curlew.1", "curlew.toml.5"):
        page = (HERE / "man" / name).read_text(encoding="utf-8")
        for word, lines in words.items():
            page = page.replace(word, "\n".join(lines))
        packed = subprocess.run(["gzip", "-9n"], input=page.encode(), stdout=subprocess.PIPE,
                                check=True).stdout
        (folder / f"{name}.gz").write_bytes(packed)


try:
    main()
except (NotUnderstood, OSError) as error:
    sys.exit(f"man_pages.py: {error}")
