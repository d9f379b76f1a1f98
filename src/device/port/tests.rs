//! The port's task against a far end that the test plays.

use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

use super::*;

/// `ok` ends, `no` refuses, `!` halts, `hello` starts, `*` is a notice.
struct Plain;

impl LineProtocol for Plain {
    fn classify(&self, line: &str) -> Kind {
        match line {
            "ok" => Kind::Done,
            "no" => Kind::Refused,
            "!" => Kind::Halted,
            "hello" => Kind::Started,
            "*" => Kind::Notice,
            _ => Kind::Data,
        }
    }
}

const SECOND: Duration = Duration::from_secs(1);

#[tokio::test(start_paused = true)]
async fn a_dropped_caller_does_not_cut_a_command_from_its_reply() {
    let (near, mut far) = duplex(256);
    let (port, _notices) = Port::start(near, Lines::new(Plain), Arc::default());
    {
        let first = port.request("first\n", SECOND, 0);
        assert!(tokio::time::timeout(Duration::from_millis(10), first).await.is_err());
    }
    let second = tokio::spawn({
        let port = port.clone();
        async move { port.request("second\n", SECOND, 0).await }
    });
    let mut buffer = [0u8; 64];
    let count = far.read(&mut buffer).await.unwrap();
    assert_eq!(&buffer[..count], b"first\n", "the second is written only after the first's end");
    far.write_all(b"one\r\nok\r\n").await.unwrap();
    let count = far.read(&mut buffer).await.unwrap();
    assert_eq!(&buffer[..count], b"second\n");
    far.write_all(b"tw").await.unwrap();
    far.write_all(b"o\r\nok\r\n").await.unwrap();
    assert_eq!(second.await.unwrap().unwrap().lines, ["two"]);
}

#[tokio::test(start_paused = true)]
async fn urgent_bytes_pass_the_queue_and_a_stop_cancels_what_waits() {
    let (near, mut far) = duplex(256);
    let (port, mut notices) = Port::start(near, Lines::new(Plain), Arc::default());
    let first = tokio::spawn({
        let port = port.clone();
        async move { port.request("first\n", SECOND, 0).await }
    });
    tokio::time::sleep(Duration::from_millis(1)).await;
    let second = tokio::spawn({
        let port = port.clone();
        async move { port.request("second\n", SECOND, 0).await }
    });
    tokio::time::sleep(Duration::from_millis(1)).await;
    port.generation.fetch_add(1, Ordering::SeqCst);
    port.urgent(b"\x85", false).unwrap().await.unwrap();
    far.write_all(b"*\nok\n").await.unwrap();
    assert!(first.await.unwrap().is_ok());
    assert_eq!(second.await.unwrap(), Err(PortError::Cancelled));
    let mut buffer = [0u8; 64];
    let count = far.read(&mut buffer).await.unwrap();
    assert_eq!(&buffer[..count], b"first\n\x85");
    assert_eq!(notices.recv().await.unwrap().line, "*");
}

#[tokio::test(start_paused = true)]
async fn after_a_timeout_nothing_is_asked_until_the_device_starts_anew() {
    let (near, mut far) = duplex(256);
    let (port, _notices) = Port::start(near, Lines::new(Plain), Arc::default());
    assert_eq!(port.request("a\n", SECOND, 0).await, Err(PortError::Timeout(SECOND)));
    assert_eq!(port.request("b\n", SECOND, 0).await, Err(PortError::OutOfStep));
    far.write_all(b"ok\nhello\n").await.unwrap();
    tokio::time::sleep(Duration::from_millis(1)).await;
    let third = tokio::spawn({
        let port = port.clone();
        async move { port.request("c\n", SECOND, 0).await }
    });
    let mut buffer = [0u8; 64];
    let count = far.read(&mut buffer).await.unwrap();
    assert_eq!(&buffer[..count], b"a\n");
    let count = far.read(&mut buffer).await.unwrap();
    assert_eq!(&buffer[..count], b"c\n");
    far.write_all(b"no\n").await.unwrap();
    assert_eq!(third.await.unwrap(), Err(PortError::Refused("no".to_owned())));
}

#[tokio::test(start_paused = true)]
async fn end_of_file_closes_the_port_and_says_so() {
    let (near, far) = duplex(256);
    let (port, _notices) = Port::start(near, Lines::new(Plain), Arc::default());
    let waiting = tokio::spawn({
        let port = port.clone();
        async move { port.request("a\n", SECOND, 0).await }
    });
    tokio::time::sleep(Duration::from_millis(1)).await;
    drop(far);
    assert!(matches!(waiting.await.unwrap(), Err(PortError::Closed(_))));
    let mut closed = port.closed();
    closed.wait_for(Option::is_some).await.unwrap();
    assert!(matches!(port.request("b\n", SECOND, 0).await, Err(PortError::Closed(_))));
    assert!(port.urgent(b"!", false).is_err());
}
