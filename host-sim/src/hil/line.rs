//! The line to the monitor: an emulated board's, or a serial port.

use super::Session;
use crate::emulator::{DEFAULT_TIME_LIMIT, Emulator, EmulatorError, Machine, RunLog};
use crate::failure::Failure;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// How long QEMU may take to connect.
const CONNECT_LIMIT: Duration = Duration::from_secs(20);
/// How long a serial port may say nothing, beyond what its monitor needs, before the run is ended.
const SILENCE_LIMIT: Duration = Duration::from_secs(5);
/// How much longer than other images an emulated board may run for each window of a session: some 0.1 s on a quiet host.
const WINDOW_LIMIT: Duration = Duration::from_secs(1);

/// Both directions of a line.
pub struct Line {
    /// From the monitor.
    pub reader: Box<dyn Read + Send>,
    /// To the monitor.
    pub writer: Box<dyn Write + Send>,
    /// Has the other side a clock of its own, so that samples must come in their time?
    pub is_real_time: bool,
    board: Option<JoinHandle<Result<RunLog, EmulatorError>>>,
}

impl Line {
    /// Builds the firmware that a session needs for an emulated board, with further features, and starts it.
    ///
    /// # Errors
    /// It does not build, or QEMU does not start.
    pub fn to_emulator(machine: Machine, features: &[&str], session: &Session) -> Result<Self, Failure> {
        let firmware = session.build_options(machine, features).build().map_err(Failure::other)?;
        let listener = TcpListener::bind(("127.0.0.1", 0)).map_err(Failure::other)?;
        listener.set_nonblocking(true).map_err(Failure::other)?;
        let port = listener.local_addr().map_err(Failure::other)?.port();
        let windows = u32::try_from(session.windows()).unwrap_or(u32::MAX);
        let emulator =
            Emulator::new(machine).time_limit(DEFAULT_TIME_LIMIT + WINDOW_LIMIT.saturating_mul(windows));
        let board = thread::spawn(move || emulator.line(port).run(&firmware));
        let deadline = Instant::now() + CONNECT_LIMIT;
        let stream: TcpStream = loop {
            match listener.accept() {
                Ok((stream, _)) => break stream,
                Err(error) if error.kind() != std::io::ErrorKind::WouldBlock => {
                    return Err(Failure::other(error));
                }
                Err(_) if board.is_finished() || Instant::now() >= deadline => {
                    return Err(end_of(board).map_or_else(
                        |failure| failure,
                        |log| Failure::other(format!("QEMU ended without a connection: {:?}", log.lines)),
                    ));
                }
                Err(_) => thread::sleep(Duration::from_millis(5)),
            }
        };
        stream.set_nonblocking(false).and_then(|()| stream.set_nodelay(true)).map_err(Failure::other)?;
        let reader = stream.try_clone().map_err(Failure::other)?;
        Ok(Self {
            reader: Box::new(reader),
            writer: Box::new(stream),
            is_real_time: false,
            board: Some(board),
        })
    }

    /// Opens a serial port for a session.
    ///
    /// # Errors
    /// The port cannot be opened.
    pub fn to_port(path: &Path, baud: u32, session: &Session) -> Result<Self, Failure> {
        let wrong = |error| Failure::other(format!("{}: {error}", path.display()));
        // A report comes when the window after its own has been sent, at the latest.
        let silence = SILENCE_LIMIT + 2 * session.window_duration();
        let port = serialport::new(path.to_string_lossy(), baud).timeout(silence).open().map_err(wrong)?;
        let reader = port.try_clone().map_err(wrong)?;
        Ok(Self { reader: Box::new(reader), writer: Box::new(port), is_real_time: true, board: None })
    }

    /// Waits for the end of an emulated board; what its run said.
    ///
    /// # Errors
    /// It ended abnormally.
    pub fn end(self) -> Result<Option<RunLog>, Failure> {
        let Self { reader, writer, board, .. } = self;
        drop((reader, writer));
        board.map(end_of).transpose()
    }
}

fn end_of(board: JoinHandle<Result<RunLog, EmulatorError>>) -> Result<RunLog, Failure> {
    let log = board.join().map_err(|_| Failure::other("the thread of the emulator failed"))?;
    log.map_err(Failure::other)
}
