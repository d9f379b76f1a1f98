"""Shows the daemon who asks: the token of an administrator, and a control lease where there is one."""

import os
import uuid

import requests
import schemathesis

TOKEN = os.environ["PLENALIGN_TOKEN"]
TOKEN_ID = os.environ["PLENALIGN_TOKEN_ID"]
LEASE = "Plenalign-Lease"

# Key of the control lease taken last.
lease = None


@schemathesis.auth()
class Token:
    def get(self, case, context):
        return TOKEN

    def set(self, case, data, context):
        case.headers["Authorization"] = f"Bearer {data}"


def free_the_bench(address):
    """Makes a job possible: ends what there is, resets the stop and takes the lease."""
    with requests.Session() as session:
        session.headers["Authorization"] = f"Bearer {TOKEN}"
        session.delete(f"{address}/api/v1/stop", json={"why": "a test goes on"}, timeout=30)
        # An administrator's takeover cancels the job of another first.
        taken = session.post(f"{address}/api/v1/lease/takeover", json={"owner": "schemathesis"}, timeout=30)
        return taken.json().get("key")


@schemathesis.hook
def before_call(context, case, kwargs):
    global lease
    if case.method.upper() == "DELETE" and "id" in case.path_parameters:
        of_job = case.path.startswith("/api/v1/jobs/")
        stateful = case.meta is not None and case.meta.phase.name.value == "stateful"
        # The one token that everything here depends on is not revoked. And to cancel a job leaves it to be read: over
        # several steps that would be taken for the use of what is gone.
        if case.path_parameters["id"] == TOKEN_ID or (of_job and stateful):
            case.path_parameters["id"] = str(uuid.uuid4())
    if case.meta is None or not case.meta.generation.mode.is_positive:
        return
    # What fits the contract is to get as far as it can: a lease's key cannot be guessed, a job needs a free bench, and a
    # key that has been used stands for the request it was used with.
    if "Idempotency-Key" in case.headers:
        case.headers["Idempotency-Key"] = str(uuid.uuid4())
    if case.operation.label == "POST /api/v1/jobs" and case.meta.phase.name.value == "stateful":
        lease = free_the_bench(kwargs.get("base_url") or case.operation.base_url) or lease
        case.headers[LEASE] = lease
    elif lease is not None and LEASE in case.headers:
        case.headers[LEASE] = lease


@schemathesis.hook
def after_call(context, case, response):
    global lease
    if response.status_code == 201 and case.operation.label in ("POST /api/v1/lease", "POST /api/v1/lease/takeover"):
        lease = response.json()["key"]
    if case.operation.label == "PUT /api/v1/simulation/faults":
        # What went wrong on purpose is not to be found.
        address = response.request.url.split("/api/")[0]
        headers = {"Authorization": f"Bearer {TOKEN}"}
        requests.put(f"{address}/api/v1/simulation/faults", json={}, headers=headers, timeout=30)
