//! The inputs of one segment between breakpoints. Every channel is one polynomial in the time since the
//! segment's start, and sines: an evaluation takes a few multiply-adds, or none if all channels are constant.

use crate::model::{Contacts, FrameMotion};
use crate::number::{Bits, Dual, LaneTask, Lanes, Lift, MOST, Real, task};

/// Highest degree of a polynomial.
pub const MAX_DEGREE: usize = 5;
pub(super) const COEFFICIENTS: usize = MAX_DEGREE + 1;
/// Number of channels: two target angles or torques, then force x, force y and moment.
pub(super) const CHANNELS: usize = 5;
pub(super) const FRAME_CHANNELS: usize = 3;

#[derive(Debug, Clone, Copy)]
pub struct Input<R> {
    /// theta_1^d and theta_2^d in rad, or the torques on the fingers in N m.
    pub target: [R; 2],
    /// Rates of the target angles, rad/s, for fingers that follow them exactly.
    pub target_rate: [R; 2],
    pub target_acceleration: [R; 2],
    /// F_x and F_y along fixed axes in N and the moment in N m that act on the object.
    pub force: [R; 3],
    pub tau: R,
}

impl<R: Copy> Input<R> {
    pub(crate) fn map<S>(&self, to: impl Fn(R) -> S) -> Input<S> {
        Input {
            target: self.target.map(&to),
            target_rate: self.target_rate.map(&to),
            target_acceleration: self.target_acceleration.map(&to),
            force: self.force.map(&to),
            tau: to(self.tau),
        }
    }
}

/// amplitude * sin(omega tau + phase), in the lanes of `active`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wave<R> {
    /// omega, phase, and the amplitudes.
    pub(super) numbers: [R; 5],
    pub(super) active: Bits,
}

/// The inputs of one segment, about its start. In lanes, each lane has a segment of its own.
#[derive(Debug, Clone)]
pub struct SegmentDrive<R = f64> {
    pub(super) channels: [[R; COEFFICIENTS]; CHANNELS],
    /// The degree of each lane's polynomials, and the highest of these degrees.
    pub(super) degrees: [usize; MOST],
    pub(super) degree: usize,
    pub(super) waves: Vec<Wave<R>>,
    pub(crate) frame: Option<Box<SegmentFrame<R>>>,
    /// The modes of the contacts until the next event. Only unilateral contact reads them.
    pub contacts: Contacts<R>,
}

/// The motion of the hand's frame in one segment, about its start.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SegmentFrame<R> {
    /// The accelerations R-dotdot_x and R-dotdot_y along fixed axes, and the tilt phi.
    pub(super) channels: [[R; COEFFICIENTS]; FRAME_CHANNELS],
    /// A sinusoid of these. Its amplitudes are zero if there is none.
    pub(super) wave: Wave<R>,
    /// The degree of the polynomials of the accelerations.
    pub(super) degree: usize,
    /// sin phi and cos phi in lanes whose tilt does not change.
    pub(super) direction: [R; 2],
    pub(super) swings: bool,
    /// Whether the tilt changes in any lane.
    pub(crate) turns: bool,
}

impl<R: Lanes> SegmentFrame<R> {
    pub(crate) fn lifted<T: Lanes>(&self, lift: impl Fn(R) -> T) -> SegmentFrame<T> {
        SegmentFrame {
            channels: self.channels.map(|channel| channel.map(&lift)),
            wave: Wave { numbers: self.wave.numbers.map(&lift), active: self.wave.active },
            direction: self.direction.map(&lift),
            degree: self.degree,
            swings: self.swings,
            turns: self.turns,
        }
    }

    fn still() -> Self {
        let zero = R::zero();
        let wave = Wave { numbers: [zero; 5], active: R::ALL };
        let (degree, swings, turns) = (0, false, false);
        let channels = [[zero; COEFFICIENTS]; FRAME_CHANNELS];
        Self { channels, wave, degree, direction: [zero; 2], swings, turns }
    }

    fn set(&mut self, lane: usize, own: &SegmentFrame<f64>) {
        set_channels(&mut self.channels, lane, &own.channels, COEFFICIENTS);
        set_numbers(&mut self.wave.numbers, lane, &own.wave.numbers);
        set_numbers(&mut self.direction, lane, &own.direction);
        self.degree = self.degree.max(own.degree);
        (self.swings, self.turns) = (self.swings | own.swings, self.turns | own.turns);
    }

    /// The constants of the accelerations along fixed axes.
    pub(crate) fn constants(&mut self) -> impl Iterator<Item = &mut R> {
        self.channels[..2].iter_mut().map(|channel| &mut channel[0])
    }

    /// The motion at time `tau` since the segment's start, compiled with the instructions of the caller.
    #[inline(always)]
    pub(crate) fn motion<T: Lift<R>>(&self, tau: T) -> FrameMotion<T> {
        let [x, y, tilt] = &self.channels;
        let (zero, mut acceleration) = (T::zero(), [T::zero(); 2]);
        for k in (0..=self.degree.min(MAX_DEGREE)).rev() {
            acceleration =
                [acceleration[0].mul_add(tau, T::lift(x[k])), acceleration[1].mul_add(tau, T::lift(y[k]))];
        }
        if !(self.swings | self.turns) {
            let [sin, cos] = self.direction.map(T::lift);
            return FrameMotion::new(acceleration, (sin, cos), None);
        }
        let series = value_and_rates(tilt, MAX_DEGREE, tau);
        let [omega, phase, x, y, tilt] = self.wave.numbers;
        let omega = T::lift(omega);
        let phase = omega.mul_add(tau, T::lift(phase));
        let (sin, cos) = if self.swings { phase.sin_cos() } else { (zero, zero) };
        let swing = T::lift(tilt);
        let phi = swing.mul_add(sin, series[0]);
        let turning = self.turns.then(|| {
            let rate = (omega * swing).mul_add(cos, series[1]);
            [rate, (omega * omega * swing).neg_mul_add(sin, series[2])]
        });
        let acceleration =
            [T::lift(x).mul_add(sin, acceleration[0]), T::lift(y).mul_add(sin, acceleration[1])];
        FrameMotion::new(acceleration, phi.sin_cos(), turning)
    }

    /// The motion `own` with the derivatives `slopes`. `joined` makes a number with its derivatives.
    fn varied<'a>(
        own: &SegmentFrame<f64>,
        slopes: impl Iterator<Item = &'a SegmentFrame<f64>>,
        joined: impl Fn(&dyn Fn(&SegmentFrame<f64>) -> f64) -> R,
    ) -> Self {
        let [sin, cos] = own.direction;
        let mut frame = Self {
            channels: std::array::from_fn(|c| std::array::from_fn(|k| joined(&|frame| frame.channels[c][k]))),
            wave: Wave {
                numbers: std::array::from_fn(|n| joined(&|frame| frame.wave.numbers[n])),
                active: R::ALL,
            },
            // The derivatives of sine and cosine of the tilt; the motion itself is not among the slopes.
            direction: [(sin, cos), (cos, -sin)].map(|(value, by_tilt)| {
                joined(&|frame| if std::ptr::eq(frame, own) { value } else { by_tilt * frame.channels[2][0] })
            }),
            degree: own.degree,
            swings: own.swings,
            turns: own.turns,
        };
        for slope in slopes {
            frame.degree = frame.degree.max(slope.degree);
            frame.swings |= slope.swings;
            frame.turns |= slope.turns;
        }
        frame
    }
}

task! {
    ['a] FrameAt<'a>(frame: &'a SegmentFrame<f64>, tau: f64) for f64 => FrameMotion<f64> = frame.motion(tau)
}

impl SegmentFrame<f64> {
    /// The motion at time `tau` since the segment's start.
    pub(crate) fn at(&self, tau: f64) -> FrameMotion<f64> {
        f64::outlined(FrameAt { frame: self, tau })
    }
}

/// A polynomial of degree `degree` at `tau`, and its first two derivatives, by Horner's scheme.
#[inline(always)]
fn value_and_rates<R: Lanes, T: Lift<R>>(channel: &[R; COEFFICIENTS], degree: usize, tau: T) -> [T; 3] {
    let (mut value, mut first, mut second) = (T::zero(), T::zero(), T::zero());
    for k in (0..=degree).rev() {
        second = second.mul_add(tau, first);
        first = first.mul_add(tau, value);
        value = value.mul_add(tau, T::lift(channel[k]));
    }
    [value, first, second + second]
}

fn set_channels<R: Lanes, const C: usize>(
    channels: &mut [[R; COEFFICIENTS]; C],
    lane: usize,
    own: &[[f64; COEFFICIENTS]; C],
    terms: usize,
) {
    for (channel, own) in channels.iter_mut().zip(own) {
        set_numbers(&mut channel[..terms], lane, own);
    }
}

fn set_numbers<R: Lanes>(numbers: &mut [R], lane: usize, own: &[f64]) {
    for (number, &own) in numbers.iter_mut().zip(own) {
        number.set(lane, own);
    }
}

impl SegmentDrive {
    /// Whether the inputs are constant in the segment.
    pub fn is_constant(&self) -> bool {
        self.degree == 0 && self.waves.is_empty() && self.frame.is_none()
    }

    /// Sets torques on the fingers that are constant in the segment, N m.
    pub fn hold(&mut self, torque: [f64; 2]) {
        for (channel, torque) in self.channels.iter_mut().zip(torque) {
            // Adding zero turns -0.0 into 0.0, as in every other channel.
            channel[0] = torque + 0.0;
        }
    }
}

impl<R: Lanes> SegmentDrive<Dual<R, 1>> {
    /// The inputs `value` of a segment, with their derivatives `slopes`; there are none in further directions. Every sinusoid has a derivative at the same place of `slopes`.
    pub fn varied(value: &SegmentDrive, slopes: &[SegmentDrive]) -> Self {
        let degree = slopes.iter().fold(value.degree, |most, slope| most.max(slope.degree));
        let joined = |number: f64, slope: &dyn Fn(&SegmentDrive) -> f64| {
            Dual::<R, 1>::varied(number, &slopes.iter().map(slope).collect::<Vec<_>>())
        };
        let wave = |k: usize, own: &Wave<f64>| {
            let slope =
                |n: usize| move |slope: &SegmentDrive| slope.waves.get(k).map_or(0.0, |wave| wave.numbers[n]);
            Wave { numbers: std::array::from_fn(|n| joined(own.numbers[n], &slope(n))), active: R::ALL }
        };
        let channel = |c: usize, k: usize| joined(value.channels[c][k], &|slope| slope.channels[c][k]);
        Self {
            channels: std::array::from_fn(|c| std::array::from_fn(|k| channel(c, k))),
            degrees: [degree; MOST],
            degree,
            waves: value.waves.iter().enumerate().map(|(k, own)| wave(k, own)).collect(),
            frame: value.frame.as_ref().map(|own| {
                let joined = |of: &dyn Fn(&SegmentFrame<f64>) -> f64| {
                    joined(of(own), &|slope| slope.frame.as_deref().map_or(0.0, of))
                };
                SegmentFrame::varied(own, slopes.iter().filter_map(|slope| slope.frame.as_deref()), joined)
                    .into()
            }),
            contacts: Contacts::sticking(),
        }
    }
}

impl<R: Lanes> SegmentDrive<R> {
    pub fn still() -> Self {
        Self {
            channels: [[R::zero(); COEFFICIENTS]; CHANNELS],
            degrees: [0; MOST],
            degree: 0,
            waves: Vec::new(),
            frame: None,
            contacts: Contacts::sticking(),
        }
    }

    pub fn set(&mut self, lane: usize, own: &SegmentDrive) {
        // The coefficients of a higher degree are zero, and were so before.
        let terms = 1 + own.degree.max(self.degrees[lane]).min(MAX_DEGREE);
        set_channels(&mut self.channels, lane, &own.channels, terms);
        if let Some(own) = &own.frame {
            let still = || SegmentFrame::still().into();
            self.frame.get_or_insert_with(still).set(lane, own);
        }
        self.degrees[lane] = own.degree;
        self.degree = self.degrees.into_iter().max().unwrap_or(0);

        let nothing = Wave { numbers: [R::zero(); 5], active: 0 };
        self.waves.resize(self.waves.len().max(own.waves.len()), nothing);
        for (k, wave) in self.waves.iter_mut().enumerate() {
            wave.active &= !(1 << lane);
            if let Some(own) = own.waves.get(k) {
                wave.active |= 1 << lane;
                set_numbers(&mut wave.numbers, lane, &own.numbers);
            }
        }
        while self.waves.last().is_some_and(|wave| wave.active == 0) {
            self.waves.pop();
        }
    }

    /// The inputs at time `tau` since the segment's start.
    #[inline(always)]
    pub fn at<T: Lift<R>>(&self, tau: T) -> Input<T> {
        let mut value = [T::zero(); CHANNELS];
        for (v, channel) in value.iter_mut().zip(&self.channels) {
            *v = T::lift(channel[0]);
        }
        if self.degree > 0 {
            for (v, channel) in value.iter_mut().zip(&self.channels) {
                let mut sum = T::lift(channel[self.degree.min(MAX_DEGREE)]);
                for k in (0..self.degree.min(MAX_DEGREE)).rev() {
                    sum = sum.mul_add(tau, T::lift(channel[k]));
                }
                *v = sum;
            }
        }
        // Horner's scheme for both derivatives. The compiler drops them after inlining where nothing uses them.
        let (mut target_rate, mut target_acceleration) = ([T::zero(); 2], [T::zero(); 2]);
        if self.degree > 0 {
            for i in 0..2 {
                let degree = self.degree.min(MAX_DEGREE);
                [_, target_rate[i], target_acceleration[i]] = value_and_rates(&self.channels[i], degree, tau);
            }
        }
        for wave in &self.waves {
            let [omega, phase, amplitudes @ ..] = wave.numbers;
            let (shape, _) = T::lift(omega).mul_add(tau, T::lift(phase)).sin_cos();
            for (v, amplitude) in value[2..].iter_mut().zip(amplitudes) {
                *v = T::select(wave.active, T::lift(amplitude).mul_add(shape, *v), *v);
            }
        }
        let [right, left, x, y, moment] = value;
        Input { target: [right, left], target_rate, target_acceleration, force: [x, y, moment], tau }
    }
}
