"""The command line as tests call it: in this process, or in one of its own."""

import json
import subprocess
import sys

from click.testing import CliRunner

from limitsurf.shell.cli.commands import main

PROGRAM = [sys.executable, "-W", "error", "-m", "limitsurf"]


def run(*arguments, stdin=None):
    return CliRunner().invoke(main, [str(a) for a in arguments], input=stdin)


def succeed(*arguments, stdin=None):
    """What is said on stdout; nothing may be said on stderr."""
    result = run(*arguments, stdin=stdin)
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    return result.stdout


def fail(*arguments, stdin=None, code=2):
    """The error's text, after checking that it is one line and nothing else."""
    result = run(*arguments, stdin=stdin)
    assert result.exit_code == code, result.output
    assert isinstance(result.exception, SystemExit)
    (line,) = result.output.splitlines()
    assert line.startswith("limitsurf: error: ")
    return line.removeprefix("limitsurf: error: ")


def facts(*arguments, stdin=None):
    """The one object that --json says, as other programs read it."""

    def no_number(name):
        raise AssertionError(f"{name} is not JSON")

    return json.loads(succeed(*arguments, "--json", stdin=stdin), parse_constant=no_number)


def pipeline(line):
    """Run a line of a shell, in which `|` and `<` may occur; what the last command says."""
    data = None
    for part in line.split(" | "):
        name, *arguments = part.replace('"', "").split()
        assert name == "limitsurf"
        if "<" in arguments:
            place = arguments.index("<")
            with open(arguments[place + 1], "rb") as file:
                data = file.read()
            del arguments[place : place + 2]
        result = run(*arguments, stdin=data)
        told = f"{part}: {result.output} {result.exception!r}"
        assert (result.exit_code, result.stderr) == (0, ""), told
        data = result.stdout_bytes
    return data


def in_one_process(script, commands, **options):
    """Run a script that finds `commands` (lists of arguments) as JSON in its argument."""
    texts = [[str(a) for a in arguments] for arguments in commands]
    done = subprocess.run(
        [sys.executable, "-c", script, json.dumps(texts)],
        capture_output=True,
        text=True,
        timeout=600,
        **options,
    )
    assert done.returncode == 0, done.stderr
    return done
