//! The ROS 2 messages a map is made of, from CDR.
//!
//! CDR (OMG DDSI-RTPS 10.2) puts four bytes before a message, the second of which tells the byte order; fields are aligned
//! to their size, counted from after those four. Sequences are read from bytes that are there: a claimed length takes no
//! memory. Frames lose a leading slash, which ROS 1 had.
//!
//! float32 carries angles and ranges to seven digits. A driver means 0.5 degrees and 6.17 m, which float32 has none of;
//! of all numbers that round to the float that is there, the one of few decimals is taken ([`few_decimals`]). So a log
//! gives the same map whether it came as decimals or as floats.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use re_cdr::{BigEndian, ByteOrder, CdrReader, Error, LittleEndian, Result};

use crate::geometry::Cov3;

/// What CDR can hold of a kind of message.
pub trait FromCdr<'a>: Sized {
    fn read<B: ByteOrder>(cdr: &mut CdrReader<'a, B>) -> Result<Self>;
}

/// Reads a message with its four leading bytes.
pub fn decode<'a, M: FromCdr<'a>>(data: &'a [u8]) -> Result<M> {
    match data {
        [0, 0, _, _, body @ ..] => M::read(&mut CdrReader::<BigEndian>::new(body)),
        [0, 1, _, _, body @ ..] => M::read(&mut CdrReader::<LittleEndian>::new(body)),
        [first, second, ..] => Err(Error::Custom(format!(
            "its encapsulation is {first:#04x}{second:02x}; 0x0000 and 0x0001 (CDR) are known"
        ))),
        _ => Err(Error::UnexpectedEof),
    }
}

/// `std_msgs/Header`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Header<'a> {
    /// Nanoseconds.
    pub stamp: i64,
    pub frame: &'a str,
}

impl<'a> FromCdr<'a> for Header<'a> {
    fn read<B: ByteOrder>(cdr: &mut CdrReader<'a, B>) -> Result<Self> {
        let seconds = i64::from(cdr.read_i32()?);
        let stamp = seconds * 1_000_000_000 + i64::from(cdr.read_u32()?);
        Ok(Self { stamp, frame: frame(cdr.read_str()?) })
    }
}

/// A frame's name; those of hostile length are cut, not kept.
fn frame(name: &str) -> &str {
    let name = name.trim_start_matches('/');
    if name.len() <= LONGEST_FRAME { name } else { (0..LONGEST_FRAME).rev().find_map(|n| name.get(..n)).unwrap_or("") }
}

const LONGEST_FRAME: usize = 256;

/// `sensor_msgs/LaserScan`, or the first echoes of a `sensor_msgs/MultiEchoLaserScan`.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan<'a> {
    pub header: Header<'a>,
    pub angle_min: f64,
    pub angle_increment: f64,
    /// Seconds from one beam to the next.
    pub time_increment: f64,
    pub range_min: f64,
    pub range_max: f64,
    /// Metres; NaN is no return, infinity nothing within range.
    pub ranges: Vec<f32>,
}

/// All of a scan's message but its ranges.
fn front<'a, B: ByteOrder>(cdr: &mut CdrReader<'a, B>) -> Result<Scan<'a>> {
    let header = Header::read(cdr)?;
    let angle_min = angle(cdr.read_f32()?);
    let _angle_max = cdr.read_f32()?;
    let angle_increment = angle(cdr.read_f32()?);
    let time_increment = f64::from(cdr.read_f32()?);
    let _scan_time = cdr.read_f32()?;
    let (range_min, range_max) = (few_decimals(cdr.read_f32()?), few_decimals(cdr.read_f32()?));
    Ok(Scan { header, angle_min, angle_increment, time_increment, range_min, range_max, ranges: Vec::new() })
}

fn floats<B: ByteOrder>(cdr: &mut CdrReader<'_, B>) -> Result<Vec<f32>> {
    let count = cdr.read_sequence_length()?;
    let bytes = cdr.read_bytes(4 * count)?;
    Ok(bytes.chunks_exact(4).map(B::read_f32).collect())
}

impl<'a> FromCdr<'a> for Scan<'a> {
    fn read<B: ByteOrder>(cdr: &mut CdrReader<'a, B>) -> Result<Self> {
        let front = front(cdr)?;
        Ok(Self { ranges: floats(cdr)?, ..front })
    }
}

/// `sensor_msgs/MultiEchoLaserScan`: of each beam the first echo, the nearest surface.
pub struct Echoes<'a>(pub Scan<'a>);

impl<'a> FromCdr<'a> for Echoes<'a> {
    fn read<B: ByteOrder>(cdr: &mut CdrReader<'a, B>) -> Result<Self> {
        let mut scan = front(cdr)?;
        for _ in 0..cdr.read_sequence_length()? {
            let count = cdr.read_sequence_length()?;
            let echoes = cdr.read_bytes(4 * count)?;
            scan.ranges.push(echoes.get(..4).map_or(f32::NAN, B::read_f32));
        }
        Ok(Self(scan))
    }
}

/// `geometry_msgs/Pose` or `Transform`: seven numbers in one order. `None` where the rotation is none.
fn isometry<B: ByteOrder>(cdr: &mut CdrReader<'_, B>) -> Result<Option<Isometry3<f64>>> {
    let [x, y, z] = [cdr.read_f64()?, cdr.read_f64()?, cdr.read_f64()?];
    let [i, j, k, w] = [cdr.read_f64()?, cdr.read_f64()?, cdr.read_f64()?, cdr.read_f64()?];
    let rotation = Quaternion::new(w, i, j, k);
    let whole = (0.5..2.0).contains(&rotation.norm()) && [x, y, z].iter().all(|v| v.abs() < FARTHEST);
    Ok(whole.then(|| Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_normalize(rotation))))
}

/// Positions beyond this are no building's, metres.
const FARTHEST: f64 = 1e6;

/// One of a `tf2_msgs/TFMessage`.
#[derive(Debug, Clone, PartialEq)]
pub struct Transform<'a> {
    pub header: Header<'a>,
    pub child: &'a str,
    /// Of the child in the header's frame.
    pub pose: Option<Isometry3<f64>>,
}

/// `tf2_msgs/TFMessage`.
pub struct Transforms<'a>(pub Vec<Transform<'a>>);

impl<'a> FromCdr<'a> for Transforms<'a> {
    fn read<B: ByteOrder>(cdr: &mut CdrReader<'a, B>) -> Result<Self> {
        let mut transforms = Vec::new();
        for _ in 0..cdr.read_sequence_length()? {
            let header = Header::read(cdr)?;
            let child = frame(cdr.read_str()?);
            transforms.push(Transform { header, child, pose: isometry(cdr)? });
        }
        Ok(Self(transforms))
    }
}

/// Where something was: of a `nav_msgs/Odometry`, a `geometry_msgs/PoseWithCovarianceStamped` or a `PoseStamped`.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting<'a> {
    pub header: Header<'a>,
    /// What was there; empty where the message does not say.
    pub child: &'a str,
    pub pose: Option<Isometry3<f64>>,
    /// In (x, y, heading) of the header's frame, where the message has one.
    pub covariance: Option<Cov3>,
}

/// The part of a 6 x 6 covariance (x, y, z and turns about them) that a plane has; `None` where it says "not known": all
/// zero, or not finite, or a negative variance.
fn planar<B: ByteOrder>(cdr: &mut CdrReader<'_, B>) -> Result<Option<Cov3>> {
    cdr.align(8)?;
    let bytes = cdr.read_bytes(36 * 8)?;
    let entry = |row: usize, column: usize| B::read_f64(&bytes[8 * (6 * row + column)..]);
    let axes = [0, 1, 5];
    let c = Cov3::from_fn(|i, j| (entry(axes[i], axes[j]) + entry(axes[j], axes[i])) / 2.0);
    let known = c.iter().all(|v| v.is_finite()) && c.diagonal().iter().all(|v| *v >= 0.0) && c.amax() > 0.0;
    Ok(known.then_some(c))
}

/// `nav_msgs/Odometry`.
pub struct Odometry<'a>(pub Sighting<'a>);

impl<'a> FromCdr<'a> for Odometry<'a> {
    fn read<B: ByteOrder>(cdr: &mut CdrReader<'a, B>) -> Result<Self> {
        let header = Header::read(cdr)?;
        let child = frame(cdr.read_str()?);
        Ok(Self(Sighting { header, child, pose: isometry(cdr)?, covariance: planar(cdr)? }))
    }
}

/// `geometry_msgs/PoseWithCovarianceStamped`.
pub struct PoseWithCovariance<'a>(pub Sighting<'a>);

impl<'a> FromCdr<'a> for PoseWithCovariance<'a> {
    fn read<B: ByteOrder>(cdr: &mut CdrReader<'a, B>) -> Result<Self> {
        let header = Header::read(cdr)?;
        Ok(Self(Sighting { header, child: "", pose: isometry(cdr)?, covariance: planar(cdr)? }))
    }
}

/// `geometry_msgs/PoseStamped`.
pub struct PoseStamped<'a>(pub Sighting<'a>);

impl<'a> FromCdr<'a> for PoseStamped<'a> {
    fn read<B: ByteOrder>(cdr: &mut CdrReader<'a, B>) -> Result<Self> {
        let header = Header::read(cdr)?;
        Ok(Self(Sighting { header, child: "", pose: isometry(cdr)?, covariance: None }))
    }
}

/// The number of at most four decimals that rounds to a float, or the float.
pub fn few_decimals(value: f32) -> f64 {
    let few = (f64::from(value) * 1e4).round() / 1e4;
    if few as f32 == value { few } else { f64::from(value) }
}

/// An angle in radians: that of at most four decimals in degrees which rounds to a float, or the float.
fn angle(value: f32) -> f64 {
    let few = ((f64::from(value).to_degrees() * 1e4).round() / 1e4).to_radians();
    if few as f32 == value { few } else { f64::from(value) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_driver_meant_comes_back_from_a_float() {
        assert_eq!(few_decimals(6.17f32), 6.17);
        assert_eq!(few_decimals(1.234_567_9_f32), f64::from(1.234_567_9_f32));
        assert_eq!(angle(0.5f64.to_radians() as f32), 0.5f64.to_radians());
        assert_eq!(angle(-std::f32::consts::FRAC_PI_2), -std::f64::consts::FRAC_PI_2);
        assert!(few_decimals(f32::NAN).is_nan() && few_decimals(f32::INFINITY) == f64::INFINITY);
    }

    fn odometry<B: ByteOrder>(order: u8) -> Vec<u8> {
        let mut bytes = vec![0, order, 0, 0];
        let mut cdr = re_cdr::CdrWriter::<B>::new(&mut bytes);
        cdr.write_i32(3);
        cdr.write_u32(7);
        cdr.write_string("/odom");
        cdr.write_string("base_link");
        [1.0, 2.0, 0.0, 0.0, 0.0, 0.6, 0.8].into_iter().for_each(|value| cdr.write_f64(value));
        (0..36).for_each(|k| cdr.write_f64(if k % 7 == 0 { 0.01 } else { 0.0 }));
        bytes
    }

    #[test]
    fn either_byte_order_is_read() {
        let (little, big) = (odometry::<LittleEndian>(1), odometry::<BigEndian>(0));
        assert!(little != big);
        for message in [little, big] {
            let Odometry(seen) = decode(&message).unwrap();
            assert_eq!(seen.header, Header { stamp: 3_000_000_007, frame: "odom" });
            assert_eq!((seen.child, seen.covariance), ("base_link", Some(Cov3::identity() * 0.01)));
            let pose = seen.pose.unwrap();
            assert!(pose.translation.y == 2.0 && (pose.rotation.euler_angles().2 - 2.0 * 0.6f64.asin()).abs() < 1e-12);
        }
    }

    #[test]
    fn a_length_that_is_not_there_takes_no_memory() {
        let mut scan = vec![0, 1, 0, 0];
        scan.extend([0; 12]);
        scan.extend([0; 28]);
        scan.extend(u32::MAX.to_le_bytes());
        assert!(decode::<Scan<'_>>(&scan).is_err() && decode::<Echoes<'_>>(&scan).is_err());
        assert!(decode::<Transforms<'_>>(&[0, 1, 0, 0, 255, 255, 255, 5]).is_err());
        assert!(decode::<Header<'_>>(&[0, 7, 0, 0]).is_err() && decode::<Header<'_>>(&[0]).is_err());
    }
}
