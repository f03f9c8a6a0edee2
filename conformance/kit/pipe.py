"""The kit's protocol: one JSON object a line, requests on stdin, answers on stdout (docs/howto/conformance.md).

`serve` turns an object with describe, eval, pdf, sample and, where light goes straight on, straight into an adapter; `Pipe` talks to an adapter.
"""
import json
import shlex
import subprocess
import sys

import numpy as np

PROTOCOL = 1


def serve(adapter, lines=sys.stdin, out=sys.stdout):
    """Answers requests until the pipe closes. An exception becomes {"error": text}."""
    for line in lines:
        try:
            answer = respond(adapter, json.loads(line))
        except Exception as error:  # The kit prints it beside the request.
            answer = {"error": f"{type(error).__name__}: {error}"}
        out.write(json.dumps(answer) + "\n")
        out.flush()


def respond(adapter, request):
    """The answer to one request."""
    kind = request["do"]
    if kind == "describe":
        return adapter.describe()
    if kind == "eval":
        return {"f": listed(adapter.eval(request, np.array(request["wo"], float).reshape(-1, 3)))}
    if kind == "pdf":
        return {"pdf": listed(adapter.pdf(request, np.array(request["wo"], float).reshape(-1, 3)))}
    if kind == "sample":
        found = adapter.sample(request, np.array(request["u"], float).reshape(-1, 3))
        return {name: listed(values) for name, values in found.items()}
    if kind == "straight":
        return {"straight": float(adapter.straight(request)) if hasattr(adapter, "straight") else 0.0}
    raise ValueError(f"do = {kind!r}: use describe, eval, pdf, sample or straight")


def listed(values):
    """Nested lists; JSON has no NaN, Python's reader takes it."""
    return np.asarray(values, float).tolist()


class Pipe:
    """An adapter that runs as a process."""

    def __init__(self, command):
        self.command = command
        self.process = subprocess.Popen(
            shlex.split(command), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1 << 20
        )

    def ask(self, request):
        try:
            self.process.stdin.write(json.dumps(request) + "\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
        except OSError:
            line = ""
        if not line:
            raise RuntimeError(f"{self.command}: the adapter ended; run it alone and give it {{\"do\": \"describe\"}}")
        answer = json.loads(line)
        if "error" in answer:
            short = {k: v for k, v in request.items() if k not in ("wo", "u")}
            raise RuntimeError(f"{self.command}: {answer['error']} at {short}")
        return answer

    def describe(self):
        found = self.ask({"do": "describe"})
        if found.get("protocol") != PROTOCOL:
            raise RuntimeError(f"{self.command}: protocol = {found.get('protocol')!r}: answer {PROTOCOL}")
        return found

    def eval(self, q, wo):
        return np.array(self.ask({**q, "do": "eval", "wo": wo.tolist()})["f"], float)

    def pdf(self, q, wo):
        return np.array(self.ask({**q, "do": "pdf", "wo": wo.tolist()})["pdf"], float)

    def sample(self, q, u):
        found = self.ask({**q, "do": "sample", "u": u.tolist()})
        return {name: np.array(values, float) for name, values in found.items()}

    def straight(self, q):
        return float(self.ask({**q, "do": "straight"})["straight"])

    def close(self):
        self.process.stdin.close()
        self.process.wait(timeout=20)
