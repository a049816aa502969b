"""The command line, run in this process."""

from warpsim.cli import main


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def printed(capsys, *arguments):
    """What a command prints that succeeds."""
    code, out, err = run(capsys, *arguments)
    assert code == 0, err
    return out


def refused(capsys, *arguments):
    """The one line of a command that is refused."""
    code, out, err = run(capsys, *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1), err
    return err
