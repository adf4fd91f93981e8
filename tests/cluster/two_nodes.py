"""A real SLURM with two nodes on this machine: each has a network, a host name and processes of its own.

Needs root and Debian's slurm-wlm, munge and iproute2. What is started is stopped again, node by node or all.
"""

import os
import shutil
import signal
import socket
import subprocess
import time
from contextlib import suppress
from pathlib import Path

TEMPLATE = Path(__file__).with_name("slurm.conf")
PROGRAMS = ("slurmctld", "slurmd", "sbatch", "munged", "ip", "nsenter", "unshare")
BRIDGE, NETWORK = "prtnet0", "10.117.43"
NODES = ("prtnet-one", "prtnet-two")
PORT = 16817


def lacking() -> str:
    """Why there can be no such cluster here; "" where there can."""
    if os.geteuid():
        return "needs root: network namespaces and daemons"
    absent = [name for name in PROGRAMS if not _program(name)]
    if absent:
        return f"needs {', '.join(absent)}: apt-get install slurm-wlm munge iproute2"
    tried = subprocess.run(["unshare", "--net", "--uts", "--pid", "--mount", "--fork", "true"], capture_output=True)
    return "" if tried.returncode == 0 else "needs namespaces, which this machine does not allow: unshare fails"


def _program(name: str) -> str | None:
    return shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin:/sbin")


def _call(*words: str, check: bool = True, **options) -> subprocess.CompletedProcess[str]:
    found = subprocess.run([_program(words[0]), *words[1:]], capture_output=True, text=True, check=False, **options)
    assert not check or found.returncode == 0, f"{' '.join(words)}: {found.stdout}{found.stderr}"
    return found


class TwoNodes:
    """`environment` leads SLURM's commands to this cluster."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.configuration = folder / "slurm.conf"
        self.environment = os.environ | {"SLURM_CONF": str(self.configuration)}
        self.daemons: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> "TwoNodes":
        try:
            self._configure()
            self._connect()
            self._munge()
            self._start("slurmctld", "-D", "-f", str(self.configuration))
            for name in NODES:
                self.start_node(name)
            self._until_idle()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for name in list(self.daemons):
            self.kill(name)
        for name in NODES:
            _call("ip", "netns", "delete", name, check=False)
        _call("ip", "link", "delete", BRIDGE, check=False)

    def start_node(self, name: str) -> None:
        """A node's slurmd, first process of its own namespace: with it all of the node ends."""
        inside = f"hostname {name} && exec {_program('slurmd')} -D -N {name} -f {self.configuration}"
        private = ("unshare", "--uts", "--pid", "--mount-proc", "--fork", "--kill-child", "sh", "-c", inside)
        self._start(name, f"--net=/run/netns/{name}", *private, program="nsenter")

    def kill(self, name: str) -> None:
        """SIGKILL to a daemon; of a node, to everything that runs on it, as when its power fails."""
        daemon = self.daemons.pop(name)
        daemon.kill()
        daemon.wait()

    def kill_job(self, job: str) -> None:
        """SIGKILL to the program of a job, as when memory runs out; scancel would ask it first, and wait."""
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                words = (process / "environ").read_bytes().split(b"\0")
                if f"SLURM_JOB_ID={job}".encode() in words and b"submitit.core" in (process / "cmdline").read_bytes():
                    found.append(int(process.name))
        assert found, f"no process of job {job}"
        for process in found:
            os.kill(process, signal.SIGKILL)

    def command(self, *words: str) -> str:
        """What a command of SLURM prints."""
        return _call(*words, env=self.environment).stdout

    def state(self, name: str) -> str:
        return self.command("sinfo", "--noheader", f"--nodes={name}", "--format=%T").strip()

    def _configure(self) -> None:
        for name in ("state", *(f"spool.{node}" for node in NODES)):
            (self.folder / name).mkdir(parents=True)
        nodes = [
            f"NodeName={name} NodeAddr={NETWORK}.{number} CPUs=1 RealMemory=1000 State=UNKNOWN"
            for number, name in enumerate(NODES, 2)
        ]
        words = {
            "HOST": socket.gethostname(),
            "ADDRESS": f"{NETWORK}.1",
            "FOLDER": str(self.folder),
            "PORT": str(PORT),
            "NODES": "\n".join(nodes),
        }
        text = TEMPLATE.read_text(encoding="utf-8")
        for name, word in words.items():
            text = text.replace(f"@{name}@", word)
        self.configuration.write_text(text, encoding="utf-8")

    def _connect(self) -> None:
        """A bridge of this machine, and a network namespace on it for each node."""
        _call("ip", "link", "add", BRIDGE, "type", "bridge")
        _call("ip", "address", "add", f"{NETWORK}.1/24", "dev", BRIDGE)
        _call("ip", "link", "set", BRIDGE, "up")
        for number, name in enumerate(NODES, 2):
            inside = ("ip", "-n", name)
            _call("ip", "netns", "add", name)
            _call("ip", "link", "add", f"prtnet{number}", "type", "veth", "peer", "name", "eth0", "netns", name)
            _call("ip", "link", "set", f"prtnet{number}", "master", BRIDGE, "up")
            _call(*inside, "address", "add", f"{NETWORK}.{number}/24", "dev", "eth0")
            _call(*inside, "link", "set", "eth0", "up")
            _call(*inside, "link", "set", "lo", "up")

    def _munge(self) -> None:
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        files = {"socket": "socket", "key-file": "key", "pid-file": "pid", "seed-file": "seed", "log-file": "log"}
        words = [f"--{option}={self.folder / f'munge.{suffix}'}" for option, suffix in files.items()]
        self._start("munged", "--foreground", "--force", *words)

    def _start(self, name: str, *words: str, program: str | None = None) -> None:
        with (self.folder / f"{name}.out").open("wb") as out:
            command = [_program(program or name), *words]
            self.daemons[name] = subprocess.Popen(command, stdout=out, stderr=out, start_new_session=True)

    def _until_idle(self, seconds: float = 30) -> None:
        for _ in range(int(seconds * 2)):
            found = _call("sinfo", "--noheader", "--format=%T", "--Node", check=False, env=self.environment).stdout
            if found.split() == ["idle"] * len(NODES):
                return
            time.sleep(0.5)
        raise AssertionError(f"the nodes are {found.split()} after {seconds:.0f} s; logs in {self.folder}")
