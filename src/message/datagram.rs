//! The datagram of a velocity, for controllers.

use super::VelocityMessage;
use super::layout::described;
use iceoryx2::prelude::ZeroCopySend;

/// The version of the layout.
const VERSION: u32 = 1;

described! {
    "ricochet.VelocityDatagram.v1"
    /// A velocity as a UDP datagram: 128 bytes without padding, each number with its lowest byte first.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::message::{VelocityDatagram, VelocityMessage};
    /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
    /// # let sample = recording.truth()?.next().unwrap()?;
    /// # let received = VelocityDatagram::new(&VelocityMessage::new(&sample, 0), 7).bytes();
    ///
    /// // The bytes as a controller receives them.
    /// let number = u64::from_le_bytes(received[8..16].try_into()?);
    /// let known = u32::from_le_bytes(received[4..8].try_into()?);
    /// let vy_m_s = f64::from_le_bytes(received[80..88].try_into()?);
    /// assert_eq!((received.len(), number), (128, 7));
    /// // Bit 3 is set if the velocity along y was measured.
    /// assert_eq!(VelocityDatagram::NUMBERS[3], "vy_m_s");
    /// assert!(known & 1 << 3 != 0 && vy_m_s < 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
    #[repr(C)]
    pub struct VelocityDatagram {
        /// The version of this layout, 1.
        pub version: u32,
        /// The numbers that were measured, one bit each: bit 0 for `center_x_px`, bit 8 for `sigma_omega_rad_s`. The others
        /// are 0 and meaningless.
        pub known: u32,
        /// The number of the datagram, from 0. A gap is a loss on the way.
        pub number: u64,
        /// The start of the acquire process that the frame belongs to.
        pub run_id: u64,
        /// The sequence number of the frame. A gap that `number` does not have is a loss in the rig.
        pub sequence: u64,
        /// The start of the exposure, ns since the Unix epoch.
        pub stamp_ns: u64,
        /// The index of the body in the rig's configuration.
        pub body: u32,
        /// The number of the `PointStatus`.
        pub status: u32,
        /// The number of the phase of the collision.
        pub phase: u32,
        /// The number of the reason why the spin is missing.
        pub rotation_status: u32,
        /// The centre along x, px.
        pub center_x_px: f64,
        /// The centre along y (down), px.
        pub center_y_px: f64,
        /// The velocity along x (right), m/s.
        pub vx_m_s: f64,
        /// The velocity along y (**up**), m/s.
        pub vy_m_s: f64,
        /// The velocity along the outward normal of the struck surface, m/s.
        pub vn_m_s: f64,
        /// The velocity along the surface's tangent, m/s.
        pub vt_m_s: f64,
        /// The spin, counter-clockwise positive, rad/s.
        pub omega_rad_s: f64,
        /// The standard uncertainty of each velocity component, m/s.
        pub sigma_v_m_s: f64,
        /// The standard uncertainty of the spin, rad/s.
        pub sigma_omega_rad_s: f64,
    }
}

impl VelocityDatagram {
    /// The names of the numbers that may be missing, in the order of their bits in `known`.
    pub const NUMBERS: [&str; 9] = [
        "center_x_px",
        "center_y_px",
        "vx_m_s",
        "vy_m_s",
        "vn_m_s",
        "vt_m_s",
        "omega_rad_s",
        "sigma_v_m_s",
        "sigma_omega_rad_s",
    ];

    /// Creates the datagram of a velocity with this number.
    pub fn new(message: &VelocityMessage, number: u64) -> Self {
        let numbers = [
            message.center_x_px,
            message.center_y_px,
            message.vx_m_s,
            message.vy_m_s,
            message.vn_m_s,
            message.vt_m_s,
            message.omega_rad_s,
            message.sigma_v_m_s,
            message.sigma_omega_rad_s,
        ];
        let known = (0..).zip(&numbers).map(|(bit, number)| u32::from(number.known == 1) << bit).sum();
        let [center_x_px, center_y_px, vx_m_s, vy_m_s, vn_m_s, vt_m_s, omega_rad_s, sigma_v_m_s, sigma_omega_rad_s] =
            numbers.map(|number| if number.known == 1 { number.value } else { 0.0 });
        Self {
            version: VERSION,
            known,
            number,
            run_id: message.run_id,
            sequence: message.sequence,
            stamp_ns: message.stamp_ns,
            body: message.body,
            status: message.status,
            phase: message.phase,
            rotation_status: message.rotation_status,
            center_x_px,
            center_y_px,
            vx_m_s,
            vy_m_s,
            vn_m_s,
            vt_m_s,
            omega_rad_s,
            sigma_v_m_s,
            sigma_omega_rad_s,
        }
    }

    /// Returns the bytes of the datagram.
    pub fn bytes(&self) -> [u8; size_of::<Self>()] {
        let words = [self.version, self.known].map(u32::to_le_bytes);
        let counts = [self.number, self.run_id, self.sequence, self.stamp_ns].map(u64::to_le_bytes);
        let names = [self.body, self.status, self.phase, self.rotation_status].map(u32::to_le_bytes);
        let numbers = [
            self.center_x_px,
            self.center_y_px,
            self.vx_m_s,
            self.vy_m_s,
            self.vn_m_s,
            self.vt_m_s,
            self.omega_rad_s,
            self.sigma_v_m_s,
            self.sigma_omega_rad_s,
        ]
        .map(f64::to_le_bytes);
        let parts = [words.as_flattened(), counts.as_flattened(), names.as_flattened(), numbers.as_flattened()];
        let mut bytes = [0; size_of::<Self>()];
        let mut places = bytes.iter_mut();
        parts.into_iter().flatten().zip(&mut places).for_each(|(byte, place)| *place = *byte);
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{Described, Number};

    #[test]
    fn the_bytes_have_each_field_at_the_offset_that_the_header_declares() {
        let number = |value| Number { value, known: 1 };
        let message = VelocityMessage {
            run_id: 3,
            sequence: 4,
            stamp_ns: 5,
            body: 6,
            status: 7,
            phase: 8,
            rotation_status: 9,
            center_x_px: number(10.5),
            vn_m_s: number(-2.5),
            sigma_omega_rad_s: number(0.25),
            ..VelocityMessage::default()
        };
        let bytes = VelocityDatagram::new(&message, 2).bytes();
        let layout = VelocityDatagram::layout();
        assert_eq!((layout.size_bytes, bytes.len()), (128, 128));
        let at = |name: &str| layout.fields.iter().find(|field| field.name == name).unwrap().offset_bytes;
        let u32_at = |name| u32::from_le_bytes(bytes[at(name)..][..4].try_into().unwrap());
        let u64_at = |name| u64::from_le_bytes(bytes[at(name)..][..8].try_into().unwrap());
        let f64_at = |name| f64::from_le_bytes(bytes[at(name)..][..8].try_into().unwrap());
        assert_eq!(["version", "body", "status", "phase", "rotation_status"].map(u32_at), [1, 6, 7, 8, 9]);
        assert_eq!(["number", "run_id", "sequence", "stamp_ns"].map(u64_at), [2, 3, 4, 5]);
        let numbers = ["center_x_px", "vn_m_s", "sigma_omega_rad_s", "vx_m_s"].map(|name| f64_at(name).to_bits());
        assert_eq!(numbers, [10.5, -2.5, 0.25, 0.0_f64].map(f64::to_bits));
        let known =
            |name: &&str| u32_at("known") >> VelocityDatagram::NUMBERS.iter().position(|of| of == name).unwrap();
        let measured = VelocityDatagram::NUMBERS.iter().filter(|name| known(name) & 1 == 1).collect::<Vec<_>>();
        assert_eq!(measured, [&"center_x_px", &"vn_m_s", &"sigma_omega_rad_s"]);
        let names = layout.fields.iter().map(|field| field.name).skip(10);
        assert!(names.eq(VelocityDatagram::NUMBERS), "the bits follow the order of the fields");
    }
}
