//! `plenalign token`: tokens made, listed and revoked on the machine itself.

use std::path::Path;
use std::process::ExitCode;

use anyhow::Context as _;
use jiff::{SignedDuration, Timestamp};
use serde_json::{Value, json};

use crate::access::{LOCAL, Scope, TokenRecord, TokenStore};
use crate::state_folder::state_folder;
use crate::store::Store;
use crate::store::records::Audit;

/// Arguments of `plenalign token`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    command: Command,
    /// Print one JSON object instead of text.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Make a token and show its secret, once.
    Create {
        /// What its holder is to be called.
        #[arg(long)]
        name: String,
        /// What it is to allow.
        #[arg(long, value_enum)]
        scope: Scope,
        /// Days until it ends by itself; left out: not before it is revoked.
        #[arg(long, value_name = "DAYS", value_parser = clap::value_parser!(u16).range(1..=36500))]
        expires_in_days: Option<u16>,
    },
    /// Show the tokens there are, without their secrets.
    List,
    /// Revoke a token, with every browser that has signed in with it.
    Revoke {
        /// Its name or id.
        token: String,
    },
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = state_folder()?;
    let store = TokenStore::open(&folder)?;
    match &args.command {
        Command::Create { name, scope, expires_in_days } => {
            let lasts = |days: u16| Timestamp::now().checked_add(SignedDuration::from_hours(24 * i64::from(days)));
            let expires_at = expires_in_days.map(lasts).transpose().context("the token would never expire")?;
            let (secret, record) = store.create(name, *scope, expires_at)?;
            let detail = json!({ "id": record.id, "name": record.name, "scope": record.scope });
            write_down(&folder, "token.create", detail);
            if args.json {
                let mut object = as_json(&record);
                object["secret"] = json!(secret.reveal());
                println!("{object}");
            } else {
                println!("{}", secret.reveal());
                eprintln!(
                    "plenalign: a token named {:?} with the scope {}, kept in {}; its secret, above, is never shown again",
                    record.name,
                    record.scope,
                    folder.display()
                );
            }
        }
        Command::List if args.json => {
            println!("{}", json!({ "tokens": store.list().iter().map(as_json).collect::<Vec<_>>() }));
        }
        Command::List => {
            for record in store.list() {
                println!("{}", line(&record));
            }
        }
        Command::Revoke { token } => {
            let record = store.revoke(token, None)?;
            write_down(&folder, "token.revoke", json!({ "id": record.id, "name": record.name }));
            if args.json {
                println!("{}", as_json(&record));
            } else {
                println!("revoked {:?}", record.name);
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Adds to the audit log what was done here, and by which user of the machine. It is done already: where the history
/// cannot be written, that is said and nothing taken back.
fn write_down(folder: &Path, what: &str, mut detail: Value) {
    detail["user"] = json!(user());
    let entry = Audit { at: Timestamp::now(), who: LOCAL.to_owned(), what: what.to_owned(), detail, from: None };
    let written = tokio::runtime::Builder::new_current_thread().enable_time().build().map_err(anyhow::Error::from);
    let written = written.and_then(|runtime| {
        let history = Store::open(folder);
        Ok(runtime.block_on(history.write(move |writer| writer.add_audit(&entry)))?)
    });
    if let Err(error) = written {
        eprintln!("plenalign: this is not in the audit log: {error:#}");
    }
}

/// Who is at the command line.
fn user() -> String {
    let id = nix::unistd::getuid();
    let found = nix::unistd::User::from_uid(id).ok().flatten();
    found.map_or_else(|| format!("user {id}"), |user| user.name)
}

fn as_json(record: &TokenRecord) -> serde_json::Value {
    json!({
        "id": record.id, "name": record.name, "scope": record.scope, "created_at": record.created_at,
        "last_used_at": record.last_used_at, "expires_at": record.expires_at,
    })
}

fn line(record: &TokenRecord) -> String {
    let day = |at: Timestamp| at.strftime("%Y-%m-%d %H:%M UTC").to_string();
    let used = record.last_used_at.map_or_else(|| "never used".to_owned(), |at| format!("last used {}", day(at)));
    let ends = match record.expires_at {
        Some(end) if end <= Timestamp::now() => format!(", EXPIRED {}", day(end)),
        Some(end) => format!(", expires {}", day(end)),
        None => String::new(),
    };
    let (id, name, scope, made) = (record.id, &record.name, record.scope.name(), day(record.created_at));
    format!("{id}  {scope:7}  {name}: made {made}, {used}{ends}")
}
