"""Shows the daemon who asks: the token of an administrator, and a control lease where there is one."""

import os
import uuid

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


@schemathesis.hook
def before_call(context, case, kwargs):
    # The one token that everything here depends on is not revoked.
    if case.path_parameters.get("id") == TOKEN_ID and case.method.upper() == "DELETE":
        case.path_parameters["id"] = str(uuid.uuid4())
    # A lease's key cannot be guessed: where one is to be shown that fits the contract, it is the one in force. Over
    # several steps no job is started: DELETE cancels it and leaves it to be read, which is no use of what is gone.
    if lease is None or case.meta is None:
        return
    starts_job = case.operation.label == "POST /api/v1/jobs"
    if LEASE in case.headers and not (starts_job and case.meta.phase.name.value == "stateful"):
        if case.meta.generation.mode.is_positive:
            case.headers[LEASE] = lease


@schemathesis.hook
def after_call(context, case, response):
    global lease
    if response.status_code == 201 and case.operation.label in ("POST /api/v1/lease", "POST /api/v1/lease/takeover"):
        lease = response.json()["key"]
