//! Who has which token, and what becomes of them on the disk.

use super::super::record::EXPIRED;
use super::*;

const DAY: SignedDuration = SignedDuration::from_hours(24);

#[test]
fn a_token_is_known_by_its_secret_until_it_is_revoked() {
    let folder = tempfile::tempdir().unwrap();
    let (command_line, daemon) = (TokenStore::open(folder.path()).unwrap(), TokenStore::open(folder.path()).unwrap());
    assert!(!daemon.ever_used());
    let (secret, made) = command_line.create("Ana", Scope::Control, None).unwrap();
    assert!(secret.reveal().starts_with(PREFIX));
    assert!(daemon.holder(&secret.digest()).is_none());
    daemon.refresh().unwrap();
    let holder = daemon.holder(&secret.digest()).unwrap();
    assert_eq!((holder.name.as_str(), holder.scope, holder.token), ("Ana", Scope::Control, Some(made.id)));
    assert!(daemon.holder(&Digest::of("")).is_none());

    let text = fs::read_to_string(folder.path().join(FILE)).unwrap();
    assert!(!text.contains(secret.reveal()) && !text.contains(&secret.reveal()[PREFIX.len()..]));

    assert_eq!(daemon.ended(&secret.digest()), None);
    let (session, _) = daemon.open_session(&holder, DAY).unwrap();
    command_line.revoke("Ana", Some("Ben")).unwrap();
    daemon.refresh().unwrap();
    assert!(daemon.holder(&secret.digest()).is_none());
    // Whoever has the token, or is signed in with it, is told; whoever guesses is not.
    for ended in [&secret, &session] {
        let told = daemon.ended(&ended.digest());
        assert!(
            matches!(&told, Some(Ended::Revoked { name, by, .. }) if name == "Ana" && by.as_deref() == Some("Ben")),
            "{told:?}"
        );
    }
    assert_eq!(daemon.ended(&Digest::of("guess")), None);
    assert!(daemon.ever_used() && !daemon.has_any());
}

#[test]
fn two_writers_lose_nothing_of_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::thread::scope(|scope| {
        for writer in 0..4 {
            scope.spawn(move || {
                let store = TokenStore::open(path).unwrap();
                for number in 0..5 {
                    store.create(&format!("{writer}-{number}"), Scope::View, None).unwrap();
                }
            });
        }
    });
    assert_eq!(TokenStore::open(path).unwrap().list().len(), 20);
}

#[test]
fn names_are_told_apart_and_ends_lie_ahead() {
    let store = TokenStore::in_memory();
    store.create("a", Scope::View, None).unwrap();
    assert!(matches!(store.create("a", Scope::View, None), Err(TokenError::Taken(_))));
    for name in ["", "  ", "a\nb", "<b>", "\u{202e}", &"x".repeat(65)] {
        assert!(matches!(store.create(name, Scope::View, None), Err(TokenError::Name(_))), "{name:?}");
    }
    for name in ["local", "one-time link", "plenalign"] {
        assert!(matches!(store.create(name, Scope::View, None), Err(TokenError::Reserved(_))), "{name:?}");
    }
    let past = Timestamp::now() - SignedDuration::from_secs(1);
    assert!(matches!(store.create("b", Scope::View, Some(past)), Err(TokenError::Past(_))));
    assert!(matches!(store.revoke("b", None), Err(TokenError::Unknown(_))));
}

#[test]
fn an_expired_token_opens_nothing() {
    let store = TokenStore::in_memory();
    let soon = Timestamp::now() + SignedDuration::from_hours(1);
    let (secret, _) = store.create("brief", Scope::Admin, Some(soon)).unwrap();
    let holder = store.holder(&secret.digest()).unwrap();
    let (session, end) = store.open_session(&holder, DAY).unwrap();
    assert_eq!(end, soon);
    assert!(store.session_holder(&session.digest()).is_some());
    // Their time comes.
    let past = Timestamp::now() - SignedDuration::from_millis(1);
    store.held().records.tokens.iter_mut().for_each(|token| token.expires_at = Some(past));
    assert!(store.holder(&secret.digest()).is_none());
    assert!(store.session_holder(&session.digest()).is_none());
    assert!(!store.has_any());
}

#[test]
fn whose_token_has_expired_is_told_for_a_while_and_who_guesses_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let store = TokenStore::open(folder.path()).unwrap();
    let end = Timestamp::now() + SignedDuration::from_hours(1);
    let (secret, _) = store.create("brief", Scope::View, Some(end)).unwrap();
    let (session, _) = store.open_session(&store.holder(&secret.digest()).unwrap(), DAY).unwrap();
    assert_eq!(store.ended(&session.digest()), None);
    // Their time comes: everything kept is as it would be then.
    let kept_at = |past: Timestamp| {
        let mut held = store.held();
        held.records.tokens.iter_mut().for_each(|token| token.expires_at = Some(past));
        held.records.sessions.iter_mut().for_each(|session| session.expires_at = past);
        held.records.tidy(Timestamp::now());
    };
    let past = Timestamp::now() - SignedDuration::from_secs(1);
    kept_at(past);
    let told = Some(Ended::Expired { name: "brief".to_owned(), at: past });
    assert_eq!((store.ended(&session.digest()), store.ended(&secret.digest())), (told.clone(), told));
    assert_eq!(store.ended(&Digest::of("guess")), None);
    assert!(store.session_holder(&session.digest()).is_none() && !store.knows("brief"));
    // In the end nobody asks any more.
    kept_at(past - EXPIRED);
    assert_eq!(store.ended(&session.digest()), None);
}

#[test]
fn a_session_ends_with_its_token_and_by_itself_and_survives_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let store = TokenStore::open(folder.path()).unwrap();
    let (token, _) = store.create("a", Scope::Control, None).unwrap();
    let holder = store.holder(&token.digest()).unwrap();
    let (one, _) = store.open_session(&holder, DAY).unwrap();
    let (two, _) = store.open_session(&holder, DAY).unwrap();
    let once = Holder { name: ONE_TIME.into(), scope: Scope::Admin, token: None };
    let (three, _) = store.open_session(&once, DAY).unwrap();

    let again = TokenStore::open(folder.path()).unwrap();
    assert_eq!(again.session_holder(&one.digest()), Some(holder));
    again.close_session(one.reveal());
    assert!(again.session_holder(&one.digest()).is_none());
    assert!(again.session_holder(&two.digest()).is_some());
    again.revoke("a", None).unwrap();
    assert!(again.session_holder(&two.digest()).is_none());
    assert!(again.session_holder(&three.digest()).is_some());
    // A session is no token.
    assert!(again.holder(&three.digest()).is_none());
}

#[test]
fn a_file_that_cannot_be_understood_opens_no_door() {
    let folder = tempfile::tempdir().unwrap();
    let store = TokenStore::open(folder.path()).unwrap();
    let (secret, _) = store.create("a", Scope::View, None).unwrap();
    fs::write(folder.path().join(FILE), "{").unwrap();
    assert!(store.refresh().is_err());
    assert!(store.holder(&secret.digest()).is_some() && store.ever_used());
    assert!(TokenStore::open(folder.path()).is_err());
    fs::remove_file(folder.path().join(FILE)).unwrap();
    store.refresh().unwrap();
    assert!(store.ever_used());
}

#[test]
fn the_last_use_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let store = TokenStore::open(folder.path()).unwrap();
    let (secret, made) = store.create("a", Scope::View, None).unwrap();
    assert_eq!(made.last_used_at, None);
    store.holder(&secret.digest()).unwrap();
    store.keep_last_uses().unwrap();
    assert!(TokenStore::open(folder.path()).unwrap().list()[0].last_used_at.is_some());
    // That of a session is its token's.
    let (_, TokenRecord { id, name, scope, .. }) = store.create("b", Scope::View, None).unwrap();
    let (session, _) =
        store.open_session(&Holder { name, scope, token: Some(id) }, SignedDuration::from_hours(1)).unwrap();
    store.session_holder(&session.digest()).unwrap();
    assert!(store.list().into_iter().find(|token| token.id == id).unwrap().last_used_at.is_some());
}
