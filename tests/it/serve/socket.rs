//! A WebSocket client (RFC 6455), as small as the tests allow.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// An open WebSocket.
pub struct Socket {
    reader: BufReader<TcpStream>,
}

impl Socket {
    /// Opens a WebSocket with further headers, each with its line end, or returns the status of the refusal.
    pub fn open(address: &str, path: &str, headers: &str) -> Result<Self, u16> {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let request = format!(
            "GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n{headers}\r\n"
        );
        stream.write_all(request.as_bytes()).unwrap();
        let mut reader = BufReader::new(stream);
        let mut line = String::new();
        reader.read_line(&mut line).unwrap();
        let status = line.split(' ').nth(1).unwrap().parse().unwrap();
        while line.trim() != "" {
            line.clear();
            reader.read_line(&mut line).unwrap();
        }
        if status == 101 { Ok(Self { reader }) } else { Err(status) }
    }

    /// Sends a text.
    pub fn send(&mut self, text: &str) {
        self.send_frame(0x81, text.as_bytes());
    }

    /// Sends bytes.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        self.send_frame(0x82, bytes);
    }

    /// Sends a message of one frame; a client masks its messages.
    fn send_frame(&mut self, opcode: u8, payload: &[u8]) {
        let mut frame = vec![opcode];
        match (u8::try_from(payload.len()), u16::try_from(payload.len())) {
            (Ok(length @ 0..=125), _) => frame.push(0x80 | length),
            (_, Ok(length)) => {
                frame.push(0x80 | 126);
                frame.extend(length.to_be_bytes());
            }
            _ => panic!("no test sends {} bytes", payload.len()),
        }
        // The mask of zeros leaves the payload as it is.
        frame.extend([0; 4]);
        frame.extend(payload);
        self.reader.get_mut().write_all(&frame).unwrap();
    }

    fn bytes(&mut self, count: usize) -> Vec<u8> {
        let mut bytes = vec![0; count];
        self.reader.read_exact(&mut bytes).unwrap();
        bytes
    }

    /// Receives the next message of texts or bytes.
    pub fn receive(&mut self) -> Vec<u8> {
        let mut message = Vec::new();
        loop {
            let head = self.bytes(2);
            let length = match head[1] & 127 {
                126 => u64::from(u16::from_be_bytes(self.bytes(2).try_into().unwrap())),
                127 => u64::from_be_bytes(self.bytes(8).try_into().unwrap()),
                length => u64::from(length),
            };
            let payload = self.bytes(length as usize);
            let (is_last, opcode) = (head[0] & 0x80 != 0, head[0] & 15);
            assert_ne!(opcode, 8, "the server has closed the WebSocket");
            if opcode < 8 {
                message.extend(payload);
                if is_last {
                    return message;
                }
            }
        }
    }

    /// Receives the next message as JSON.
    pub fn json(&mut self) -> serde_json::Value {
        serde_json::from_slice(&self.receive()).unwrap()
    }
}
