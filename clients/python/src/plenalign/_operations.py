"""The daemon's operations.

Written from the contract by `tools/generate.py`: change that, not this.
"""

from typing import NamedTuple


class Operation(NamedTuple):
    """An operation: its method and path, and what it takes beside a body."""

    method: str
    path: str
    query: tuple[str, ...] = ()
    headers: tuple[str, ...] = ()


LIST_AUDIT = Operation("GET", "/api/v1/audit", query=("limit", "cursor"))
HOME_AXIS = Operation("POST", "/api/v1/axes/{axis}/home", headers=("Plenalign-Lease",))
END_JOG = Operation("DELETE", "/api/v1/axes/{axis}/jog")
JOG_AXIS = Operation("POST", "/api/v1/axes/{axis}/jog", headers=("Plenalign-Lease",))
MOVE_AXIS = Operation("POST", "/api/v1/axes/{axis}/move", headers=("Plenalign-Lease",))
GET_BENCH = Operation("GET", "/api/v1/bench")
GET_CONFIG = Operation("GET", "/api/v1/config")
PUT_CONFIG = Operation("PUT", "/api/v1/config", headers=("If-Match",))
GET_CONFIG_SCHEMA = Operation("GET", "/api/v1/config/schema")
VALIDATE_CONFIG = Operation("POST", "/api/v1/config/validate")
GET_DESIGN = Operation("GET", "/api/v1/design")
DRAFT_DESIGN = Operation("POST", "/api/v1/design")
GET_DEVICES = Operation("GET", "/api/v1/devices")
GET_DOCS = Operation("GET", "/api/v1/docs")
GET_FRAME_PNG = Operation("GET", "/api/v1/frame.png")
LIST_JOBS = Operation("GET", "/api/v1/jobs", query=("limit", "cursor", "state", "kind", "since", "until", "q"))
CREATE_JOB = Operation("POST", "/api/v1/jobs", headers=("Plenalign-Lease", "Idempotency-Key"))
CANCEL_JOB = Operation("DELETE", "/api/v1/jobs/{id}")
GET_JOB = Operation("GET", "/api/v1/jobs/{id}")
CONFIRM_STEP = Operation("POST", "/api/v1/jobs/{id}/confirm")
EXPORT_JOB_CSV = Operation("GET", "/api/v1/jobs/{id}/export.csv")
EXPORT_JOB_JSON = Operation("GET", "/api/v1/jobs/{id}/export.json")
GET_JOB_ITERATIONS = Operation("GET", "/api/v1/jobs/{id}/iterations")
GET_JOB_LOG = Operation("GET", "/api/v1/jobs/{id}/log")
GET_JOB_MEASUREMENTS = Operation("GET", "/api/v1/jobs/{id}/measurements")
GET_JOB_MOVES = Operation("GET", "/api/v1/jobs/{id}/moves")
GET_JOB_RECORDING = Operation("GET", "/api/v1/jobs/{id}/recording")
GET_JOB_REPORT = Operation("GET", "/api/v1/jobs/{id}/report.html")
RELEASE_LEASE = Operation("DELETE", "/api/v1/lease", headers=("Plenalign-Lease",))
GET_LEASE = Operation("GET", "/api/v1/lease")
TAKE_LEASE = Operation("POST", "/api/v1/lease")
RENEW_LEASE = Operation("POST", "/api/v1/lease/heartbeat", headers=("Plenalign-Lease",))
TAKE_OVER_LEASE = Operation("POST", "/api/v1/lease/takeover")
GET_MEASUREMENT = Operation("GET", "/api/v1/measurement")
LIST_MEASUREMENTS = Operation("GET", "/api/v1/measurements", query=("limit", "cursor"))
MEASURE = Operation("POST", "/api/v1/measurements")
GET_OPENAPI = Operation("GET", "/api/v1/openapi.json")
SIGN_OUT = Operation("DELETE", "/api/v1/session")
GET_SESSION = Operation("GET", "/api/v1/session")
SIGN_IN = Operation("POST", "/api/v1/session")
PUT_SHELL = Operation("PUT", "/api/v1/shell", headers=("Plenalign-Lease",))
DELETE_FAULT_PLAN = Operation("DELETE", "/api/v1/simulation/fault-plan")
GET_FAULT_PLAN = Operation("GET", "/api/v1/simulation/fault-plan")
PUT_FAULT_PLAN = Operation("PUT", "/api/v1/simulation/fault-plan")
GET_FAULTS = Operation("GET", "/api/v1/simulation/faults")
PUT_FAULTS = Operation("PUT", "/api/v1/simulation/faults")
GET_SNAPSHOT = Operation("GET", "/api/v1/snapshot.jpg", query=("reduce", "quality"))
RESET_STOP = Operation("DELETE", "/api/v1/stop")
GET_STOP = Operation("GET", "/api/v1/stop")
STOP = Operation("POST", "/api/v1/stop")
GET_STREAM = Operation("GET", "/api/v1/stream.mjpg", query=("reduce", "quality", "max_rate_hz"))
CREATE_TICKET = Operation("POST", "/api/v1/tickets")
LIST_TOKENS = Operation("GET", "/api/v1/tokens")
CREATE_TOKEN = Operation("POST", "/api/v1/tokens")
REVOKE_TOKEN = Operation("DELETE", "/api/v1/tokens/{id}")
GET_VIEW = Operation("GET", "/api/v1/view", query=("lenses",))
GET_VIEW_JPEG = Operation("GET", "/api/v1/view.jpg", query=("kind", "angle", "distance_mm", "quality"))
GET_VIEW_PNG = Operation("GET", "/api/v1/view.png", query=("kind", "angle", "distance_mm", "quality"))
OPEN_WEBSOCKET = Operation("GET", "/api/v1/ws", query=("after", "boot_id"))
GET_HEALTH = Operation("GET", "/healthz")
GET_METRICS = Operation("GET", "/metrics")
GET_READINESS = Operation("GET", "/readyz")
