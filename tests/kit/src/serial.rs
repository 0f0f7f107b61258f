//! Serial lines made of pseudo terminals: what a program writes to its device arrives at the other end, as over a
//! cable or a pair of modems.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use serialport::{SerialPort as _, TTYPort};

/// An open end of a line.
#[derive(Debug)]
pub struct Port(TTYPort);

impl Port {
    /// Opens the device of this name, as a program does.
    pub fn open(name: &str) -> Port {
        let port = TTYPort::open(&serialport::new(name, 57_600));
        Port::new(port.expect("the device"))
    }

    fn new(mut port: TTYPort) -> Port {
        let limit = Duration::from_millis(20);
        port.set_timeout(limit).expect("a time-out");
        Port(port)
    }

    /// Reads what has arrived, without waiting; 0 where nothing has.
    pub fn read(&mut self, buffer: &mut [u8]) -> usize {
        match self.0.bytes_to_read() {
            Ok(1..) => self.0.read(buffer).unwrap_or(0),
            _ => 0,
        }
    }

    /// Writes; bytes for which the line has no room are lost.
    pub fn write(&mut self, bytes: &[u8]) {
        let _ = self.0.write_all(bytes);
    }
}

/// The near end of a pseudo terminal; a program opens the far end by its [`name`](Device::name).
#[derive(Debug)]
pub struct Device {
    /// The near end.
    pub port: Port,
    /// The path of the device for the program.
    pub name: String,
    /// Keeps the line open while the program restarts.
    _held: File,
}

impl Device {
    /// A new pseudo terminal.
    pub fn new() -> Device {
        let (port, far) = TTYPort::pair().expect("a pseudo terminal");
        let name = far.name().expect("the name of a pseudo terminal");
        // Opened as a plain file: a port that is opened as a serial port is locked, and the program could not open
        // it.
        let held = File::options().read(true).write(true).open(&name);
        drop(far);
        Device {
            port: Port::new(port),
            name,
            _held: held.expect("the device"),
        }
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
    /// Bytes carried from the first device to the second, and back.
    carried: [Arc<AtomicU64>; 2],
    carrier: Option<JoinHandle<()>>,
}

/// One end of a line.
enum End {
    Device(Device),
    /// A program that sends UDP to this socket, and the address it last sent from.
    Udp(UdpSocket, Option<SocketAddr>),
}

impl Line {
    /// A line from a device to a program that uses UDP on this port of the loopback address; returns the device's
    /// name.
    pub fn to_udp(port: u16) -> (Line, String) {
        let device = Device::new();
        let name = device.name.clone();
        let socket = UdpSocket::bind(("127.0.0.1", port)).expect("a loopback socket");
        socket.set_nonblocking(true).expect("it need not block");
        let line = Line::between(End::Device(device), End::Udp(socket, None), None);
        (line, name)
    }

    /// A line between two devices; returns their names.
    pub fn between_devices() -> (Line, [String; 2]) {
        let (here, there) = (Device::new(), Device::new());
        let names = [here.name.clone(), there.name.clone()];
        let line = Line::between(End::Device(here), End::Device(there), None);
        (line, names)
    }

    /// The same at this baud rate, ten bits a byte: bytes that are written faster wait in the devices.
    pub fn at_baud(baud: u32) -> (Line, [String; 2]) {
        let (here, there) = (Device::new(), Device::new());
        let names = [here.name.clone(), there.name.clone()];
        let line = Line::between(End::Device(here), End::Device(there), Some(baud));
        (line, names)
    }

    /// Bytes carried so far, from the first device to the second, and back.
    pub fn carried(&self) -> [u64; 2] {
        self.carried.each_ref().map(|count| count.load(Relaxed))
    }

    fn between(mut here: End, mut there: End, baud: Option<u32>) -> Line {
        let ended = Arc::new(AtomicBool::new(false));
        let carried = [(); 2].map(|()| Arc::new(AtomicU64::new(0)));
        let (ends, counts) = (Arc::clone(&ended), carried.clone());
        let carrier = thread::spawn(move || {
            let mut buffer = [0; 1_024];
            let mut paces = [(); 2].map(|()| Pace::of(baud));
            while !ends.load(Relaxed) {
                let mut moved = 0;
                for (at, (count, pace)) in counts.iter().zip(&mut paces).enumerate() {
                    let (from, to) = match at {
                        0 => (&mut here, &mut there),
                        _ => (&mut there, &mut here),
                    };
                    let room = pace.room().min(buffer.len());
                    let length = from.read(&mut buffer[..room]);
                    to.write(&buffer[..length]);
                    pace.take(length);
                    count.fetch_add(length as u64, Relaxed);
                    moved += length;
                }
                if moved == 0 {
                    thread::sleep(Duration::from_millis(1));
                }
            }
        });
        Line {
            ended,
            carried,
            carrier: Some(carrier),
        }
    }
}

/// How many bytes one direction may carry by now.
struct Pace {
    bytes_s: Option<f64>,
    /// When the budget was last increased.
    since: Instant,
    saved: f64,
}

impl Pace {
    fn of(baud: Option<u32>) -> Pace {
        Pace {
            bytes_s: baud.map(|baud| f64::from(baud) / 10.0),
            since: Instant::now(),
            saved: 0.0,
        }
    }

    fn room(&mut self) -> usize {
        let Some(bytes_s) = self.bytes_s else {
            return usize::MAX;
        };
        let now = Instant::now();
        self.saved += (now - self.since).as_secs_f64() * bytes_s;
        self.since = now;
        // The budget of an idle line does not grow, except for the rounds of this thread.
        self.saved = self.saved.min(bytes_s * IDLE_S);
        self.saved as usize
    }

    fn take(&mut self, length: usize) {
        self.saved -= length as f64;
    }
}

/// Longer than a round takes, on a machine with other work too.
const IDLE_S: f64 = 0.02;

impl End {
    fn read(&mut self, buffer: &mut [u8]) -> usize {
        match self {
            End::Device(device) => device.port.read(buffer),
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
            End::Device(device) => device.port.write(bytes),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_57600_baud_carries_5760_bytes_a_second_and_loses_none() {
        let (line, [here, there]) = Line::at_baud(57_600);
        let mut near = File::options().write(true).open(here).expect("a device");
        let far = File::options().read(true).open(there).expect("a device");
        let begun = Instant::now();
        let sender = thread::spawn(move || near.write_all(&[0x55; SENT]).expect("it is written"));
        let mut bytes = [0; SENT];
        let mut far = far;
        far.read_exact(&mut bytes).expect("all of it");
        let took = begun.elapsed().as_secs_f64();
        sender.join().expect("it has sent");
        assert_eq!(bytes, [0x55; SENT]);
        // What has arrived is counted a moment later.
        let until = Instant::now() + Duration::from_secs(2);
        while line.carried() != [SENT as u64, 0] && Instant::now() < until {
            thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(line.carried(), [SENT as u64, 0]);
        let expected = SENT as f64 / 5_760.0;
        assert!(took > 0.9 * expected && took < 5.0 * expected, "{took} s");
    }

    const SENT: usize = 2_880;
}
