//! The port's task against a far end that the test plays.

use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

use super::*;

/// A protocol of lines that answers without looking at the request, and picks urgent bytes out of the stream.
trait LineProtocol: Send + 'static {
    /// Tells what a line means.
    fn classify(&self, line: &str) -> Kind;
}

/// A [`LineProtocol`] with its buffer.
#[derive(Debug, Default)]
struct Lines<P> {
    protocol: P,
    buffer: LineBuffer,
}

impl<P: LineProtocol> Lines<P> {
    /// An empty buffer in front of the protocol.
    fn new(protocol: P) -> Self {
        Self { protocol, buffer: LineBuffer::default() }
    }
}

impl<P: LineProtocol> Protocol for Lines<P> {
    type Message = String;
    const RECOVERY: Recovery = Recovery::Required;
    const URGENT_ANYWHERE: bool = true;

    fn frame(&mut self, bytes: &[u8]) -> Vec<String> {
        self.buffer.push(bytes)
    }

    fn classify(&self, message: &String, _: Option<&[u8]>) -> Kind {
        self.protocol.classify(message)
    }

    fn text(&self, message: &String) -> String {
        message.clone()
    }
}

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
async fn of_an_answer_without_end_a_part_is_kept_and_others_wait_no_longer_than_allowed() {
    let (near, mut far) = duplex(256);
    let (port, _notices) = Port::start(near, Lines::new(Plain), Arc::default());
    let asked = tokio::spawn({
        let port = port.clone();
        async move { port.request("a\n", SECOND, 0).await }
    });
    for _ in 0..2 * MOST_PARTS {
        far.write_all(b"data\n").await.unwrap();
    }
    far.write_all(b"ok\n").await.unwrap();
    assert_eq!(asked.await.unwrap().unwrap().lines.len(), MOST_PARTS);
    // What goes on for ever does not put the deadline off.
    let asked = tokio::spawn(async move { port.request("b\n", SECOND, 0).await });
    let babbler = tokio::spawn(async move {
        while far.write_all(b"data\n").await.is_ok() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    });
    let begun = tokio::time::Instant::now();
    assert_eq!(asked.await.unwrap(), Err(PortError::Timeout(SECOND)));
    assert!(begun.elapsed() < SECOND + Duration::from_millis(50), "{:?}", begun.elapsed());
    babbler.await.unwrap();
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

/// Lines whose answers repeat the request; urgent bytes must not cut one.
#[derive(Default)]
struct Framed(LineBuffer);

impl Protocol for Framed {
    type Message = String;
    const RECOVERY: Recovery = Recovery::Required;
    const URGENT_ANYWHERE: bool = false;

    fn frame(&mut self, bytes: &[u8]) -> Vec<String> {
        self.0.push(bytes)
    }

    fn classify(&self, message: &String, request: Option<&[u8]>) -> Kind {
        let asked = request.is_some_and(|request| request.trim_ascii() == message.as_bytes());
        if asked { Kind::Last } else { Kind::Noise }
    }

    fn text(&self, message: &String) -> String {
        message.clone()
    }
}

async fn read_all(far: &mut tokio::io::DuplexStream, count: usize) -> Vec<u8> {
    let mut bytes = vec![0u8; count];
    far.read_exact(&mut bytes).await.unwrap();
    bytes
}

#[tokio::test(start_paused = true)]
async fn a_stop_waits_for_the_end_of_the_message_being_written() {
    let (near, mut far) = duplex(4);
    let (port, _notices) = Port::start(near, Framed::default(), Arc::default());
    let request = tokio::spawn({
        let port = port.clone();
        async move { port.request("abcdefgh\n", SECOND, 0).await }
    });
    tokio::time::sleep(Duration::from_millis(1)).await;
    port.generation.fetch_add(1, Ordering::SeqCst);
    let written = port.urgent(b"!\n", false).unwrap();
    assert_eq!(read_all(&mut far, 11).await, b"abcdefgh\n!\n");
    written.await.unwrap();
    far.write_all(b"abcdefgh\n").await.unwrap();
    assert_eq!(request.await.unwrap().unwrap().lines, ["abcdefgh"]);
}

#[tokio::test(start_paused = true)]
async fn a_command_of_which_nothing_is_written_yet_is_not_written_after_a_stop() {
    let (near, mut far) = duplex(4);
    let (port, _notices) = Port::start(near, Framed::default(), Arc::default());
    // The line is full.
    port.urgent(b"xxxx", false).unwrap().await.unwrap();
    let request = tokio::spawn({
        let port = port.clone();
        async move { port.request("move\n", SECOND, 0).await }
    });
    tokio::time::sleep(Duration::from_millis(1)).await;
    port.generation.fetch_add(1, Ordering::SeqCst);
    let written = port.urgent(b"!\n", false).unwrap();
    assert_eq!(request.await.unwrap(), Err(PortError::Cancelled));
    assert_eq!(read_all(&mut far, 6).await, b"xxxx!\n");
    written.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_question_whose_answer_can_be_no_others_brings_a_port_back_into_step() {
    let (near, mut far) = duplex(256);
    let (port, _notices) = Port::start(near, Framed::default(), Arc::default());
    assert_eq!(port.ask("a\n", SECOND).await, Err(PortError::Timeout(SECOND)));
    assert_eq!(port.ask("b\n", SECOND).await, Err(PortError::OutOfStep));
    let back = tokio::spawn({
        let port = port.clone();
        async move { port.resynchronise("who\n", SECOND).await }
    });
    tokio::time::sleep(Duration::from_millis(1)).await;
    // The late answer comes first.
    far.write_all(b"a\nwho\n").await.unwrap();
    assert_eq!(back.await.unwrap().unwrap().lines, ["who"]);
    let asked = tokio::spawn(async move { port.ask("b\n", SECOND).await });
    tokio::time::sleep(Duration::from_millis(1)).await;
    far.write_all(b"b\n").await.unwrap();
    assert_eq!(asked.await.unwrap().unwrap().lines, ["b"]);
}
