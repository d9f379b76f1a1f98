//! The page's files: what a browser may keep of them, and what it installs.

use std::collections::BTreeSet;

use reqwest::header::HeaderMap;
use serde_json::Value;

use super::daemon::Daemon;
use super::fakes::fakes;

const ASSETS: &str = "/assets/";

fn header<'a>(headers: &'a HeaderMap, name: &str) -> &'a str {
    headers.get(name).map_or("", |value| value.to_str().unwrap())
}

/// Paths of assets that a text names, whether absolute or by file name alone.
fn assets_in(text: &str) -> BTreeSet<String> {
    let found = text.split(['"', '\'', '`', '(', ')']).filter_map(|part| {
        let name = part.trim_start_matches(['.', '/']).trim_start_matches("assets/");
        let is_name = name.ends_with(".js") || name.ends_with(".css");
        (is_name && part.contains(ASSETS)).then(|| format!("{ASSETS}{name}"))
    });
    found.collect()
}

/// What is in the name of an asset besides its kind: eight characters of base 64, by what it holds.
fn hash(path: &str) -> Option<&str> {
    let stem = path.rsplit_once('.')?.0;
    let at = stem.len().checked_sub(8)?;
    let (name, hash) = (stem.get(..at)?, stem.get(at..)?);
    let whole = hash.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_".contains(&byte));
    (name.ends_with('-') && whole).then_some(hash)
}

#[tokio::test]
async fn what_a_name_stands_for_is_kept_for_good_and_everything_else_asked_for_each_time() {
    let daemon = Daemon::start(fakes().bench).await;
    let mut assets = BTreeSet::new();
    for path in ["/", "/login", "/api/v1/docs"] {
        let response = daemon.get(path).await;
        assert_eq!(header(response.headers(), "cache-control"), "no-cache", "{path}");
        let etag = header(response.headers(), "etag").to_owned();
        let html = response.text().await.unwrap();
        assert!(!html.contains("was not built"), "`make web`, and build the tests again");
        assets.extend(assets_in(&html));
        let again = daemon.request(reqwest::Method::GET, path).header("if-none-match", &etag).send().await.unwrap();
        assert_eq!((again.status().as_u16(), header(again.headers(), "cache-control")), (304, "no-cache"), "{path}");
    }
    assert!(assets.iter().any(|path| path.ends_with(".js")) && assets.iter().any(|path| path.ends_with(".css")));
    // What they load in turn, the workers among it.
    for path in assets.clone() {
        assets.extend(assets_in(&daemon.get(&path).await.text().await.unwrap()));
    }
    assert!(assets.iter().any(|path| path.contains("viewer-worker")), "{assets:?}");
    for path in &assets {
        assert!(hash(path).is_some(), "{path} is not named by what it holds");
        let response = daemon.get(path).await;
        assert_eq!(response.status(), 200, "{path}");
        assert_eq!(header(response.headers(), "cache-control"), "public, max-age=31536000, immutable", "{path}");
    }
    // Nothing that is not there, and nothing live, is kept at all.
    for path in ["/assets/index-00000000.js", "/api/v1/bench", "/api/v1/recent", "/healthz"] {
        assert_eq!(header(daemon.get(path).await.headers(), "cache-control"), "no-store", "{path}");
    }
}

#[tokio::test]
async fn it_can_be_installed() {
    let daemon = Daemon::start(fakes().bench).await;
    let html = daemon.get("/").await.text().await.unwrap();
    assert!(!html.contains("was not built"), "`make web`, and build the tests again");
    assert!(html.contains("rel=\"manifest\" href=\"/manifest.webmanifest\""));
    let response = daemon.get("/manifest.webmanifest").await;
    assert_eq!(header(response.headers(), "content-type"), "application/manifest+json");
    assert_eq!(header(response.headers(), "cache-control"), "no-cache");
    let manifest: Value = response.json().await.unwrap();
    let icons = manifest["icons"].as_array().unwrap();
    assert!(icons.len() >= 3);
    for icon in icons {
        let (path, kind) = (icon["src"].as_str().unwrap(), icon["type"].as_str().unwrap());
        let response = daemon.get(path).await;
        assert_eq!((response.status().as_u16(), header(response.headers(), "content-type")), (200, kind), "{path}");
        let file = response.bytes().await.unwrap();
        assert!(file.len() < 30_000, "{path} has {} bytes", file.len());
        if kind == "image/png" {
            let picture = image::load_from_memory(&file).unwrap();
            assert_eq!(icon["sizes"], format!("{}x{}", picture.width(), picture.height()), "{path}");
        }
    }
}
