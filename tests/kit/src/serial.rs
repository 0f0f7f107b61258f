//! Serial lines made of pseudo terminals: what a program writes to its device arrives at the other end, as through a
//! cable or a pair of modems.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use serialport::{SerialPort as _, TTYPort};

/// The near end of a pseudo terminal; a program opens the far end by its [`name`](Device::name).
#[derive(Debug)]
pub struct Device {
    port: TTYPort,
    /// The path of the device for the program.
    pub name: String,
    /// Keeps the line open while the program restarts.
    _held: File,
}

impl Device {
    /// Makes one.
    pub fn new() -> Device {
        let (mut port, far) = TTYPort::pair().expect("a pseudo terminal");
        port.set_timeout(Duration::from_millis(20))
            .expect("a time-out");
        let name = far.name().expect("the name of a pseudo terminal");
        // Held as a plain file: a port that is open as a port is locked, and the program could not open it.
        let held = File::options().read(true).write(true).open(&name);
        drop(far);
        Device {
            port,
            name,
            _held: held.expect("the device"),
        }
    }

    /// What has arrived, without waiting; 0 where nothing has.
    pub fn read(&mut self, buffer: &mut [u8]) -> usize {
        match self.port.bytes_to_read() {
            Ok(1..) => self.port.read(buffer).unwrap_or(0),
            _ => 0,
        }
    }

    /// Writes; what the line has no room for is lost.
    pub fn write(&mut self, bytes: &[u8]) {
        let _ = self.port.write_all(bytes);
    }
}

impl Default for Device {
    fn default() -> Self {
        Device::new()
    }
}

/// A line between two programs. It ends when this value is dropped.
#[derive(Debug)]
pub struct Line {
    ended: Arc<AtomicBool>,
    carrier: Option<JoinHandle<()>>,
}

/// One end of a line.
enum End {
    Device(Device),
    /// A program that speaks UDP to this socket, and where it sent from last.
    Udp(UdpSocket, Option<SocketAddr>),
}

impl Line {
    /// From a device to a program that speaks UDP to this port of the loopback address; the device's name.
    pub fn to_udp(port: u16) -> (Line, String) {
        let device = Device::new();
        let name = device.name.clone();
        let socket = UdpSocket::bind(("127.0.0.1", port)).expect("a loopback socket");
        socket.set_nonblocking(true).expect("it need not block");
        let line = Line::between(End::Device(device), End::Udp(socket, None));
        (line, name)
    }

    /// From one device to another; their names.
    pub fn between_devices() -> (Line, [String; 2]) {
        let (here, there) = (Device::new(), Device::new());
        let names = [here.name.clone(), there.name.clone()];
        (Line::between(End::Device(here), End::Device(there)), names)
    }

    fn between(mut here: End, mut there: End) -> Line {
        let ended = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&ended);
        let carrier = thread::spawn(move || {
            let mut buffer = [0; 1_024];
            while !ends.load(Relaxed) {
                let there_from_here = here.read(&mut buffer);
                there.write(&buffer[..there_from_here]);
                let here_from_there = there.read(&mut buffer);
                here.write(&buffer[..here_from_there]);
                if there_from_here + here_from_there == 0 {
                    thread::sleep(Duration::from_millis(1));
                }
            }
        });
        Line {
            ended,
            carrier: Some(carrier),
        }
    }
}

impl End {
    fn read(&mut self, buffer: &mut [u8]) -> usize {
        match self {
            End::Device(device) => device.read(buffer),
            End::Udp(socket, from) => match socket.recv_from(buffer) {
                Ok((length, sender)) => {
                    *from = Some(sender);
                    length
                }
                Err(_) => 0,
            },
        }
    }

    fn write(&mut self, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        match self {
            End::Device(device) => device.write(bytes),
            End::Udp(socket, Some(to)) => {
                let _ = socket.send_to(bytes, *to);
            }
            End::Udp(_, None) => {}
        }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.ended.store(true, Relaxed);
        if let Some(carrier) = self.carrier.take() {
            let _ = carrier.join();
        }
    }
}
