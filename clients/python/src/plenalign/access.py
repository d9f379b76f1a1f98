"""Who may ask, and who did what."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from uuid import UUID

from . import _operations as op
from ._transport import Transport
from .models import (
    Audit,
    AuditList,
    NewToken,
    Scope,
    SessionView,
    Ticket,
    TicketRequest,
    TokenList,
    TokenRequest,
    TokenView,
)


class Access:
    """Tokens, tickets and the audit log."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def who_am_i(self) -> SessionView:
        """Who one is to the daemon, and what one may do."""
        return self._transport.ask(op.GET_SESSION).as_(SessionView)

    def tokens(self) -> list[TokenView]:
        """The tokens there are, without their secrets."""
        return self._transport.ask(op.LIST_TOKENS).as_(TokenList).tokens

    def create_token(self, name: str, scope: Scope | str, *, expires_at: datetime | None = None) -> NewToken:
        """Makes a token, whose secret is told here and never again."""
        if expires_at is not None and expires_at.tzinfo is None:
            raise ValueError("expires_at has no time zone: datetime(…, tzinfo=timezone.utc)")
        body = TokenRequest(name=name, scope=Scope(scope), expires_at=expires_at)
        return self._transport.ask(op.CREATE_TOKEN, body=body).as_(NewToken)

    def revoke_token(self, token: TokenView | UUID | str) -> None:
        """Revokes a token."""
        self._transport.ask(op.REVOKE_TOKEN, path={"id": token.id if isinstance(token, TokenView) else token})

    def ticket(self, path: str) -> Ticket:
        """A ticket that opens a path of the API once, for what cannot show a token, such as an image's address."""
        return self._transport.ask(op.CREATE_TICKET, body=TicketRequest(path=path)).as_(Ticket)

    def audit(self, *, page: int = 100) -> Iterator[Audit]:
        """Who did what, and from where, newest first."""
        cursor: str | None = None
        while True:
            listed = self._transport.ask(op.LIST_AUDIT, query={"limit": page, "cursor": cursor}).as_(AuditList)
            yield from listed.entries
            cursor = listed.next
            if cursor is None:
                return
