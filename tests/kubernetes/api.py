"""As much of Kubernetes' API as Snakemake's executor uses, on one machine: a job's container is a process here.

  python api.py PORT_FILE

Listens on a free port of this machine, writes its number into PORT_FILE, and runs until it is ended. Every job is held
against Kubernetes' own schema first. What a real cluster does besides (images, volumes, nodes, quotas) it does not.
"""
import json
import os
import subprocess
import sys
import tempfile
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import kubernetes_validate

BATCH = "/apis/batch/v1/namespaces/default/jobs"
jobs = {}


def run(job):
    container = job["spec"]["template"]["spec"]["containers"][0]
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(container["command"] + container["args"], cwd=folder, stdin=subprocess.DEVNULL,
                              stdout=sys.stderr, stderr=sys.stderr)
    job["status"] = {"succeeded": 1} if done.returncode == 0 else {"failed": 1}


class Api(BaseHTTPRequestHandler):
    def answer(self, body, status=200):
        text = json.dumps(body).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)

    def body(self):
        return json.loads(self.rfile.read(int(self.headers.get("Content-Length") or 0)) or "{}")

    def do_POST(self):
        body = self.body()
        if self.path != BATCH:
            return self.answer(body, 201)
        job = {"apiVersion": "batch/v1", "kind": "Job", **body}
        try:
            kubernetes_validate.validate(job, kubernetes_validate.latest_version(), strict=True)
        except kubernetes_validate.ValidationError as error:
            return self.answer({"kind": "Status", "message": str(error), "code": 422}, 422)
        name = job["metadata"]["name"]
        print("job", name, file=sys.stderr, flush=True)
        jobs[name] = {**job, "status": {"active": 1}}
        threading.Thread(target=run, args=[jobs[name]], daemon=True).start()
        self.answer(job, 201)

    def do_GET(self):
        if self.path.startswith(BATCH):
            name = self.path.removeprefix(BATCH).strip("/").split("/")[0]
            return self.answer(jobs[name]) if name in jobs else self.answer({"kind": "Status", "code": 404}, 404)
        self.answer({"apiVersion": "v1", "kind": "PodList", "metadata": {}, "items": []})

    def do_DELETE(self):
        self.body()
        self.answer({"apiVersion": "v1", "kind": "Status", "status": "Success"})

    def log_message(self, *_):
        pass


server = ThreadingHTTPServer(("127.0.0.1", 0), Api)
with open(sys.argv[1] + ".partial", "w") as file:
    file.write(str(server.server_port))
os.rename(sys.argv[1] + ".partial", sys.argv[1])
server.serve_forever()
