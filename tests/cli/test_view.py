"""``jssa-gym view`` as it is typed."""

import http.client
import os
import signal
import socket
import subprocess
import sys
import time
from functools import partial

import pytest
from commands import WITHOUT, cli, one_line
from places import PATIENCE

from jssa_gym.cli.view import ViewCommand

OPTIONS = ("task", "robot", "human", "policy", "shields", "seed", "out", "port", "host", "token", "open")


def test_help_says_what_every_option_is_for(here):
    said = here("view", "--help").stdout
    for option in OPTIONS:
        assert f"--{option}" in said
    assert set(ViewCommand.__dataclass_fields__) == set(OPTIONS)
    assert "(required)" not in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--host", "192.168.1.7"), "--token"),
        (("--host", "0.0.0.0", "--token", "x" * 20), "one address"),
        (("--token", "short"), "16 or more"),
        (("--policy", "reach-ppo", "--shields", "none"), "verified stop"),
        (("--shields", "yield", "work", "stop"), "1 or 2 shields"),
        (("--shields", "no_such"), "unknown filter 'no_such'"),
        (("--task", "no_such"), "unknown task 'no_such'"),
        (("--human", "no_such"), "unknown human 'no_such'"),
        (("--robot", "no_such"), "unknown robot 'no_such'"),
        (("--port", "70000"), "between 0 and 65535"),
        (("--seed", "-1"), "seed"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(here, tmp_path, arguments, said):
    assert said in one_line(here("view", *arguments, "--out", tmp_path / "out"))
    assert list(tmp_path.iterdir()) == []


def test_a_port_that_is_taken_is_said(here, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"port {port}" in one_line(here("view", "--port", port, "--out", tmp_path / "out"))


@pytest.mark.long
@pytest.mark.parametrize("module", ["viser", "trimesh", "msgspec"])
def test_without_the_extra_it_says_what_to_install(module, tmp_path):
    run = cli("view", "--out", tmp_path, before=WITHOUT.format(blocked=[module]))
    said = one_line(run)
    assert "jssa-gym[viewer]" in said
    assert module in said


@pytest.mark.long
def test_it_prints_its_address_serves_the_page_and_ends_at_ctrl_c(tmp_path):
    pytest.importorskip("viser", reason="the extra 'viewer' is not installed")
    command = [sys.executable, "-m", "jssa_gym", "view", "--port", "0", "--out", str(tmp_path / "out")]
    # whoever runs the tests in the background may have it ignored, which children inherit
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    pipes = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, text=True, env=os.environ, preexec_fn=heard, **pipes) as run:
        try:
            address = next(line for line in run.stderr if line.startswith("open ")).split()[1]
            assert address.startswith("http://127.0.0.1:")
            connection = http.client.HTTPConnection(address.split("/")[2], timeout=PATIENCE)
            connection.request("GET", "/")
            assert connection.getresponse().status == 200
            connection.close()
            time.sleep(0.5)
            run.send_signal(signal.SIGINT)
            out, err = run.communicate(timeout=PATIENCE)  # what compiles meanwhile is finished first
        finally:
            run.kill()
    assert run.returncode == 0
    assert out == ""
    assert "closed" in err
    assert "Traceback" not in err
