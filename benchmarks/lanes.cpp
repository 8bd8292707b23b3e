// The null-space form of null_space.py, in eight lanes of the vector types of gcc and clang, by RK4.
// ensemble_peers.py compiles it where it is run: it is a peer, no part of the package.

#include <cstdint>

typedef double Lanes __attribute__((vector_size(64)));
typedef std::int64_t Longs __attribute__((vector_size(64)));
enum { WIDTH = 8, STATES = 14, PARAMETERS = 25 };
#define INLINE static inline __attribute__((always_inline))

// Both at once: Cody and Waite's reduction to +-pi/4, and fdlibm's polynomials.
INLINE void sine_cosine(Lanes x, Lanes &sine, Lanes &cosine) {
    const Lanes k = (x * 0x1.45f306dc9c883p-1 + 0x1.8p52) - 0x1.8p52;
    const Lanes r = (x - k * 0x1.921fb54442d18p0) - k * 0x1.1a62633145c07p-54;
    const Lanes z = r * r, w = z * z;
    // In pairs, which waits less than one after the other.
    const Lanes s = (-1.66666666666666324348e-01 + z * 8.33333333332248946124e-03)
        + w * ((-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06)
        + w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10));
    const Lanes c = (4.16666666666666019037e-02 + z * -1.38888888888741095749e-03)
        + w * ((2.48015872894767294178e-05 + z * -2.75573143513906633035e-07)
        + w * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11));
    const Lanes near_sine = r + (r * z) * s, near_cosine = (1.0 - 0.5 * z) + w * c;
    const Longs n = __builtin_convertvector(k, Longs), odd = (n & 1) != 0;
    const Lanes a = odd ? near_cosine : near_sine, b = odd ? near_sine : near_cosine;
    sine = (Lanes)((Longs)a ^ ((n & 2) << 62));
    cosine = (Lanes)((Longs)b ^ (((n + 1) & 2) << 62));
}

struct Finger {
    Lanes uu, uv, uw, vv, vw, ww, ru, rv, rw;
    Lanes share_u, share_v, share_w, alone, slip, lag;
};

// What a finger adds to the object's 3 x 3 system once its own angle is eliminated.
template <int k> INLINE Finger finger(const Lanes *y, const Lanes *c, Lanes cosine, Lanes sine) {
    constexpr double s = k == 0 ? -1.0 : 1.0;
    const Lanes length = c[0], half = c[2], radius = c[5], stiffness = c[6], kappa = c[9];
    const Lanes m_n = c[10], m_t = c[11], turn = y[11], rate = y[12 + k], d_t = y[5 + k];
    const Lanes u = y[9] * cosine + y[10] * sine, v = y[10] * cosine - y[9] * sine;
    Lanes sin_a, cos_a;
    sine_cosine(y[3 + k], sin_a, cos_a);
    const Lanes x0 = y[0] - s * (length * sin_a + half * cos_a - c[1]);
    const Lanes z0 = y[1] - (length * cos_a - half * sin_a);
    const Lanes x = x0 * cosine + z0 * sine, g = z0 * cosine - x0 * sine;
    const Lanes face = 0.5 * c[12] + s * c[15], d_n = radius + face - s * x;
    const Lanes sin_p = sin_a * cosine + s * (cos_a * sine);
    const Lanes cos_p = cos_a * cosine - s * (sin_a * sine);
    const Lanes normal = length * sin_p + half * cos_p, across = length * cos_p - half * sin_p;
    const Lanes a = s * g, b = -across, e = -s * face, f = normal + radius - d_n;
    const Lanes d_n_rate = -(s * u + a * turn + b * rate);
    const Lanes d_t_rate = -(v + e * turn + f * rate);
    const Lanes g_rate = v - x * turn + normal * rate, x_rate = u + g * turn - s * across * rate;
    const Lanes tilt_rate = rate + s * turn;
    const Lanes bias_h = s * (v + g_rate) * turn + normal * tilt_rate * rate;
    const Lanes bias_n = (across * tilt_rate - d_n_rate) * rate - (u + x_rate + s * d_n_rate) * turn;
    const Lanes secant = 1.0 / cos_p, tangent = sin_p * secant;
    const Lanes area = (d_n * secant) * (d_n * secant), leaning = kappa * tangent * d_n;
    const Lanes twist = stiffness * area * ((2.0 / 3.0) * d_n * tangent + kappa * d_t);
    const Lanes press = stiffness * (area + 2.0 * leaning * d_t + d_t * d_t);
    const Lanes shear = stiffness * d_n * (leaning + 2.0 * d_t) ;
    const Lanes h = m_n * bias_h - press - c[7] * d_n_rate;
    const Lanes t = m_t * bias_n - shear - c[8] * d_t_rate;
    const Lanes lag = y[3 + k] - c[20 + k];
    const Lanes torque = c[3] * c[19] * c[0] * sin_a - c[16] * lag - c[17] * rate - c[18] * y[7 + k]
        - twist - (b * h + f * t);
    const Lanes mb = m_n * b, mf = m_t * f, ma = m_n * a, me = m_t * e;
    const Lanes row_u = s * mb, row_v = mf, row_w = ma * b + me * f;
    const Lanes pivot = 1.0 / (c[4] + mb * b + mf * f);
    const Lanes share_u = row_u * pivot, share_v = row_v * pivot, share_w = row_w * pivot;
    return {m_n - row_u * share_u, -row_u * share_v, s * ma - row_u * share_w,
            m_t - row_v * share_v, me - row_v * share_w, ma * a + me * e - row_w * share_w,
            -s * h - share_u * torque, -t - share_v * torque,
            -s * twist - (a * h + e * t) - share_w * torque,
            share_u, share_v, share_w, torque * pivot, d_t_rate, lag};
}

INLINE void rates(const Lanes *y, const Lanes *c, Lanes *out) {
    Lanes sine, cosine;
    sine_cosine(y[2], sine, cosine);
    const Finger one = finger<0>(y, c, cosine, sine), two = finger<1>(y, c, cosine, sine);
    const Lanes force_x = c[22], force_y = c[23] - c[13] * c[19];
    const Lanes uu = c[13] + one.uu + two.uu, uv = one.uv + two.uv, uw = one.uw + two.uw;
    const Lanes ru = one.ru + two.ru + force_x * cosine + force_y * sine;
    const Lanes inverse = 1.0 / uu, l_v = uv * inverse, l_w = uw * inverse;
    const Lanes vv = c[13] + one.vv + two.vv - l_v * uv, vw = one.vw + two.vw - l_w * uv;
    const Lanes ww = c[14] + one.ww + two.ww - l_w * uw;
    const Lanes rv = one.rv + two.rv + force_y * cosine - force_x * sine - l_v * ru;
    const Lanes rw = one.rw + two.rw + c[24] - l_w * ru;
    const Lanes inverse_v = 1.0 / vv, l_vw = vw * inverse_v;
    const Lanes w = (rw - l_vw * rv) / (ww - l_vw * vw);
    const Lanes v = rv * inverse_v - l_vw * w, u = ru * inverse - l_v * v - l_w * w;
    for (int i = 0; i < 5; i++) out[i] = y[9 + i];
    out[5] = one.slip, out[6] = two.slip, out[7] = one.lag, out[8] = two.lag;
    out[9] = u * cosine - v * sine, out[10] = u * sine + v * cosine, out[11] = w;
    out[12] = one.alone - one.share_u * u - one.share_v * v - one.share_w * w;
    out[13] = two.alone - two.share_u * u - two.share_v * v - two.share_w * w;
}

// states (14, runs) are advanced by `steps` of dt; parameters (25, runs); runs divides by eight.
extern "C" void rk4(double *states, const double *parameters, long runs, long steps, double dt) {
    for (long at = 0; at < runs; at += WIDTH) {
        Lanes y[STATES], z[STATES], k[STATES], sum[STATES], c[PARAMETERS];
        for (int i = 0; i < PARAMETERS; i++)
            __builtin_memcpy(&c[i], parameters + i * runs + at, sizeof(Lanes));
        for (int i = 0; i < STATES; i++)
            __builtin_memcpy(&y[i], states + i * runs + at, sizeof(Lanes));
        for (long step = 0; step < steps; step++) {
            rates(y, c, k);
            for (int i = 0; i < STATES; i++) sum[i] = k[i], z[i] = y[i] + 0.5 * dt * k[i];
            rates(z, c, k);
            for (int i = 0; i < STATES; i++) sum[i] += 2.0 * k[i], z[i] = y[i] + 0.5 * dt * k[i];
            rates(z, c, k);
            for (int i = 0; i < STATES; i++) sum[i] += 2.0 * k[i], z[i] = y[i] + dt * k[i];
            rates(z, c, k);
            for (int i = 0; i < STATES; i++) y[i] += (dt / 6.0) * (sum[i] + k[i]);
        }
        for (int i = 0; i < STATES; i++)
            __builtin_memcpy(states + i * runs + at, &y[i], sizeof(Lanes));
    }
}
