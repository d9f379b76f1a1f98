//! Asking a controller what it is: the answer, and that nothing but the question is sent.

use std::sync::{Arc, Mutex};

use plenalign::config::ControllerConfig;
use plenalign::device::open::driver;
use plenalign::device::serial::Wire;
use plenalign::sim::stage::Protocol;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, DuplexStream, duplex};

use super::kit::{Kit, every_protocol};

/// A stream to a twin that keeps what is sent to it.
fn listened(kit: &Kit) -> (Wire, Arc<Mutex<Vec<u8>>>) {
    let (near, middle) = duplex(1024);
    let (other, far) = duplex(1024);
    let (twin, sent) = (kit.twin.clone(), Arc::<Mutex<Vec<u8>>>::default());
    tokio::spawn(async move { twin.serve(far).await });
    let (from_driver, to_driver) = tokio::io::split(middle);
    let (from_twin, to_twin) = tokio::io::split(other);
    tokio::spawn(pass(from_driver, to_twin, Some(Arc::clone(&sent))));
    tokio::spawn(pass(from_twin, to_driver, None));
    (Box::new(near), sent)
}

async fn pass(
    mut from: tokio::io::ReadHalf<DuplexStream>,
    mut to: tokio::io::WriteHalf<DuplexStream>,
    kept: Option<Arc<Mutex<Vec<u8>>>>,
) {
    let mut buffer = [0; 256];
    while let Ok(count @ 1..) = from.read(&mut buffer).await {
        if let Some(kept) = &kept {
            kept.lock().unwrap().extend(&buffer[..count]);
        }
        if to.write_all(&buffer[..count]).await.is_err() {
            break;
        }
    }
}

fn config(driver: Protocol) -> ControllerConfig {
    ControllerConfig { driver: driver.driver(), port: "/dev/null".into(), baud: None, identity: None, address: 1 }
}

every_protocol!(it_says_what_it_is_and_is_told_nothing, where_nothing_answers_that_is_said);

async fn it_says_what_it_is_and_is_told_nothing(of: Protocol) {
    let kit = Kit::new(of);
    let before = [kit.slides.at(0), kit.slides.at(1)];
    let (wire, sent) = listened(&kit);
    let identity = driver(&config(of)).identify(wire, "controller `main`").await.unwrap();
    let sent = sent.lock().unwrap().clone();
    let text = String::from_utf8_lossy(&sent).into_owned();
    match of {
        Protocol::Grbl | Protocol::GrblHal | Protocol::FluidNc => {
            let begin = match of {
                Protocol::Grbl => "Grbl 1.1",
                Protocol::GrblHal => "GrblHAL 1.1",
                _ => "FluidNC v3.9.1",
            };
            assert!(identity.starts_with(begin), "{identity}");
            assert!(sent.is_empty() || text == "$I\n", "{text:?}");
        }
        Protocol::Zaber => {
            assert!(identity.starts_with("Zaber device "), "{identity}");
            assert!(!text.is_empty() && text.lines().all(|line| line.contains(" get ")), "{text:?}");
        }
        Protocol::Pi => {
            assert!(identity.contains("Physik Instrumente"), "{identity}");
            assert_eq!(text, "*IDN?\n");
        }
        Protocol::Tmcl => {
            assert!(identity.starts_with("TMCM-"), "{identity}");
            assert!(!sent.is_empty() && sent.len() % 9 == 0, "{sent:02x?}");
            // 136: the version.
            assert!(sent.chunks(9).all(|frame| frame[1] == 136), "{sent:02x?}");
        }
        Protocol::Thorlabs => {
            assert!(identity.starts_with("Thorlabs BSC203"), "{identity}");
            // 5: what a unit is, of a unit of its own and of a main board.
            assert!(sent.len() == 12 && sent.chunks(6).all(|header| header[..2] == [5, 0]), "{sent:02x?}");
        }
    }
    assert_eq!([kit.slides.at(0), kit.slides.at(1)], before);
}

async fn where_nothing_answers_that_is_said(of: Protocol) {
    let (near, _far) = duplex(1024);
    let refused = driver(&config(of)).identify(Box::new(near), "controller `main`").await.unwrap_err().to_string();
    assert!(refused.contains("controller `main` did not say what it is"), "{refused}");
}
