//! Serial lines of pseudo terminals: what a program writes to its device comes out at the other end, as through a cable
//! or a pair of modems.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use serialport::{SerialPort as _, TTYPort};

/// A line that carries until this value goes.
pub(crate) struct Line {
    over: Arc<AtomicBool>,
    carrying: Option<JoinHandle<()>>,
}

/// One end of a line.
enum End {
    Device(Device),
    /// A program that speaks UDP to this socket, and where it spoke from last.
    Udp(UdpSocket, Option<SocketAddr>),
}

/// A pseudo terminal: our end of it, and the program's, held so that the line outlives the program.
struct Device(TTYPort, #[expect(dead_code, reason = "held")] File);

impl Line {
    /// From a device to a program that speaks UDP to this port of the loopback; the device's name.
    pub(crate) fn to_udp(port: u16) -> (Line, String) {
        let (device, name) = device();
        let socket = UdpSocket::bind(("127.0.0.1", port)).expect("a loopback socket");
        socket.set_nonblocking(true).expect("it need not block");
        (
            Line::between(End::Device(device), End::Udp(socket, None)),
            name,
        )
    }

    /// From one device to another; their names.
    pub(crate) fn of_two_devices() -> (Line, [String; 2]) {
        let ((here, this), (there, that)) = (device(), device());
        let line = Line::between(End::Device(here), End::Device(there));
        (line, [this, that])
    }

    fn between(mut here: End, mut there: End) -> Line {
        let over = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&over);
        let carrying = thread::spawn(move || {
            let mut buffer = [0; 1_024];
            while !ends.load(Relaxed) {
                let heard = here.read(&mut buffer);
                there.write(&buffer[..heard]);
                let answered = there.read(&mut buffer);
                here.write(&buffer[..answered]);
                if heard + answered == 0 {
                    thread::sleep(Duration::from_millis(1));
                }
            }
        });
        Line {
            over,
            carrying: Some(carrying),
        }
    }
}

impl End {
    /// What has come; 0 where nothing has.
    fn read(&mut self, buffer: &mut [u8]) -> usize {
        match self {
            End::Device(Device(port, _)) => match port.bytes_to_read() {
                Ok(1..) => port.read(buffer).unwrap_or(0),
                _ => 0,
            },
            End::Udp(socket, from) => match socket.recv_from(buffer) {
                Ok((bytes, sender)) => {
                    *from = Some(sender);
                    bytes
                }
                Err(_) => 0,
            },
        }
    }

    /// What a line has no room for, or nobody at its end, is lost.
    fn write(&mut self, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        let _ = match self {
            End::Device(Device(port, _)) => port.write_all(bytes),
            End::Udp(socket, Some(to)) => socket.send_to(bytes, *to).map(drop),
            End::Udp(_, None) => Ok(()),
        };
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.over.store(true, Relaxed);
        if let Some(carrying) = self.carrying.take() {
            let _ = carrying.join();
        }
    }
}

fn device() -> (Device, String) {
    let (mut near, far) = TTYPort::pair().expect("a pseudo terminal");
    near.set_timeout(Duration::from_millis(20))
        .expect("a time-out");
    let name = far.name().expect("the name of a pseudo terminal");
    // A port that is open as one is locked for the program.
    let held = File::options().read(true).write(true).open(&name);
    drop(far);
    (Device(near, held.expect("the device")), name)
}
