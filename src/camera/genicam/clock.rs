//! Conversion of device timestamps to host time.

/// A device clock this close to the host's is synchronised with it (PTP, simulators) and taken as it is.
const SYNCHRONISED_NS: i64 = 100_000_000;

/// Length of the windows whose least delayed frame gives the offset.
const WINDOW_NS: i64 = 1_000_000_000;

/// Maximum correction of the clock rate: no quartz oscillator is worse.
const MAX_RATE: f64 = 500e-6;

/// Proportional gain of the loop per window: the share of the clock error that the rate corrects in the next window.
const PROPORTIONAL_GAIN: f64 = 0.3;
/// Integral gain of the loop per window: the share of the clock error that goes into the estimated drift.
const INTEGRAL_GAIN: f64 = 0.05;

/// Converts device timestamps to host time, ns since the Unix epoch.
///
/// The arrival delay of a frame is never negative, so the least delayed frame of each second gives the best estimate of
/// the offset (E. Olson, "A passive solution to the sensor synchronization problem", IROS 2010,
/// <https://doi.org/10.1109/IROS.2010.5650579>). The offset follows it through a slow proportional-integral loop
/// without jumps. Differences of stamps thus equal those of the device clock to within 0.05 %, and after some seconds
/// to within the drift between the two clocks.
///
/// A device clock that agrees with the host's from the start is not changed.
#[derive(Debug, Default)]
pub struct DeviceClock {
    /// `None` before the first frame.
    relation: Option<ClockRelation>,
}

/// The relation of the device clock to host time.
#[derive(Debug)]
enum ClockRelation {
    /// The device clock is host time.
    Same,
    /// `host = device + offset_ns + rate * (device - start_ns)`.
    Drifting {
        /// Device time at the start of the window, ns.
        start_ns: i64,
        /// Host time minus device time at the start of the window, ns.
        offset_ns: i64,
        /// Correction of the clock rate in this window, as a fraction.
        rate: f64,
        /// Sum of the loop, an estimate of the relative drift of the two clocks.
        integral: f64,
        /// Minimum of arrival minus converted time in this window, ns.
        min_error_ns: i64,
    },
}

impl DeviceClock {
    /// Returns the host time of the camera's timestamp of a frame, ns since the Unix epoch.
    ///
    /// `device_ns` is that timestamp, 0 if there is none. `arrival_ns` is the host time at which the frame's first
    /// packet arrived. It is returned for a frame without a timestamp, and is otherwise the measure of the offset.
    pub fn stamp_ns(&mut self, device_ns: u64, arrival_ns: u64) -> u64 {
        let (Ok(signed_device_ns), Ok(signed_arrival_ns)) = (i64::try_from(device_ns), i64::try_from(arrival_ns))
        else {
            return arrival_ns;
        };
        if device_ns == 0 {
            return arrival_ns;
        }
        match self.relation.get_or_insert_with(|| ClockRelation::from_first_frame(signed_device_ns, signed_arrival_ns))
        {
            ClockRelation::Same => device_ns,
            relation => relation.update(signed_device_ns, signed_arrival_ns),
        }
    }
}

impl ClockRelation {
    /// Returns the relation after one frame: the same clock if the two times agree to within [`SYNCHRONISED_NS`], else
    /// the offset between them.
    fn from_first_frame(device_ns: i64, arrival_ns: i64) -> Self {
        let offset_ns = arrival_ns - device_ns;
        if offset_ns.abs() < SYNCHRONISED_NS {
            return Self::Same;
        }
        Self::Drifting { start_ns: device_ns, offset_ns, rate: 0.0, integral: 0.0, min_error_ns: i64::MAX }
    }

    /// Converts the device time of a frame to host time, ns since the Unix epoch.
    ///
    /// A frame that ends a window of [`WINDOW_NS`] also updates rate and offset, for the frames after it. The same
    /// clock needs no conversion.
    fn update(&mut self, device_ns: i64, arrival_ns: i64) -> u64 {
        let Self::Drifting { start_ns, offset_ns, rate, integral, min_error_ns } = self else {
            return u64::try_from(device_ns).unwrap_or(0);
        };
        let elapsed_ns = device_ns - *start_ns;
        let correction_ns = (*rate * elapsed_ns as f64) as i64;
        let stamp_ns = device_ns + *offset_ns + correction_ns;
        *min_error_ns = (*min_error_ns).min(arrival_ns - stamp_ns);
        if elapsed_ns >= WINDOW_NS {
            let relative_error = *min_error_ns as f64 / elapsed_ns as f64;
            *integral = (*integral + INTEGRAL_GAIN * relative_error).clamp(-MAX_RATE, MAX_RATE);
            *rate = (*integral + PROPORTIONAL_GAIN * relative_error).clamp(-MAX_RATE, MAX_RATE);
            *offset_ns += correction_ns;
            *start_ns = device_ns;
            *min_error_ns = i64::MAX;
        }
        u64::try_from(stamp_ns).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOST_START: u64 = 1_700_000_000_000_000_000;

    /// Delays between 100 us and 1.1 ms, the same in every run.
    fn delay_ns(frame: u64) -> u64 {
        100_000 + (frame.wrapping_mul(6_364_136_223_846_793_005) >> 33) % 1_000_000
    }

    #[test]
    fn a_clock_set_by_the_host_is_taken_as_it_is() {
        let mut clock = DeviceClock::default();
        for frame in 0..5000 {
            let device = HOST_START + frame * 1_000_000;
            assert_eq!(clock.stamp_ns(device, device + delay_ns(frame)), device);
        }
    }

    #[test]
    fn without_a_device_clock_the_arrival_is_the_stamp() {
        assert_eq!(DeviceClock::default().stamp_ns(0, HOST_START), HOST_START);
    }

    #[test]
    fn a_clock_80_ppm_fast_is_followed_to_a_third_of_a_millisecond_without_a_jump() {
        let mut clock = DeviceClock::default();
        let (mut last, mut worst) = (0, 0);
        for frame in 0..120_000_u64 {
            let host = HOST_START + frame * 1_000_000;
            let device = 5_000_000_000 + frame * 1_000_080;
            let stamp = clock.stamp_ns(device, host + delay_ns(frame));
            if frame > 0 {
                let step = stamp - last;
                assert!(step.abs_diff(1_000_000) <= 650, "frame {frame}: {step} ns");
            }
            if frame > 60_000 {
                worst = worst.max(stamp.abs_diff(host));
            }
            last = stamp;
        }
        // The minimum delay, 100 us, is not observable; the rest is the loop's.
        assert!(worst < 333_000, "{worst} ns");
    }

    #[test]
    fn a_step_of_the_host_clock_never_turns_stamps_back() {
        let mut clock = DeviceClock::default();
        let mut last = 0;
        for frame in 0..10_000_u64 {
            let step = if frame < 5000 { 60_000_000_000 } else { 0 };
            let stamp = clock.stamp_ns(1_000_000 * (frame + 1), HOST_START + frame * 1_000_000 + step);
            assert!(stamp > last);
            last = stamp;
        }
    }
}
