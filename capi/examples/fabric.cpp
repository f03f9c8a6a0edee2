// A renderer's material in C++17: a woven fabric with frames, uv, straight light through gaps, RGB and multiple importance sampling.
//
//     fabric [FABRIC.toml]
//
// Renders what a point of the cloth sends to the camera under a lamp, by sampling the lamp, the material and both: the three agree. Then four threads share the material.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <plywave.h>
#include <random>
#include <stdexcept>
#include <thread>
#include <vector>

// [material]
using Color = std::array<float, 3>; // linear sRGB
using Vec = std::array<float, 3>;

inline float dot(const Vec &a, const Vec &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

struct Hit {                  // what a renderer knows of a ray's hit
    Vec s, t, n;              // along u, along v, normal of the face: orthonormal
    Vec wo;                   // towards where the ray came from
    std::array<float, 2> uv;  // texture coordinates
    float footprint = 0.0f;   // width of the ray there, in uv; 0 is a point
    const float *sigma = nullptr; // the texel's absorptions [1/um] (plywave_fabric_sigma_of_reflectance), if it has some
};

class Material {
  public:
    // One unit of uv is as large as `um_per_uv`; `turn` turns the pattern [rad].
    Material(const char *path, float um_per_uv, float turn = 0.0f, const PlywaveFabricOptions *options = nullptr)
        : um_per_uv_(um_per_uv), turn_(turn) {
        check(plywave_fabric_load(path, options, &fabric_, &error_), error_);
    }
    ~Material() { plywave_fabric_free(fabric_); }
    Material(const Material &) = delete;
    Material &operator=(const Material &) = delete;

    // The material at a hit. It is 8 KB on the stack and owns nothing.
    class Point {
      public:
        // `jitter` in [0, 1)^2: yarns narrower than the ray's footprint are averaged by the samples of the pixel.
        Point(const Material &m, const Hit &hit, std::array<float, 2> jitter = {0.5f, 0.5f}) : hit_(hit) {
            PlywaveFabricQuery q = {};
            for (int k = 0; k < 2; ++k) q.position_um[k] = (hit.uv[k] + hit.footprint * (jitter[k] - 0.5f)) * m.um_per_uv_;
            for (int k = 0; k < 3; ++k) q.wo[k] = local(hit.wo)[k];
            q.count = 3;
            q.channels = PLYWAVE_CHANNELS_LINEAR_SRGB;
            q.turn_rad = m.turn_;
            q.sigma_warp_per_um = q.sigma_weft_per_um = hit.sigma;
            PlywaveError error;
            check(plywave_fabric_at(m.fabric_, &q, &bsdf_, &error), error);
        }
        // The BSDF times the cosine, and the density with which `sample` gives the direction, for multiple importance sampling.
        Color eval(const Vec &wi, float *pdf) const {
            Color f = {};
            plywave_bsdf_eval_pdf(&bsdf_, local(wi).data(), f.data(), pdf, nullptr);
            return f;
        }
        struct Sample {
            enum { Absorbed, Scattered, Straight } kind; // Straight is a delta: go on along the ray, no lamp is sampled
            Vec wi;
            Color weight;
            float pdf;
        };
        Sample sample(const Vec &u) const {
            PlywaveSample s;
            if (plywave_bsdf_sample(&bsdf_, u.data(), &s, nullptr) != PLYWAVE_STATUS_OK) return {Sample::Absorbed, {}, {}, 0.0f};
            Vec wi = {-hit_.wo[0], -hit_.wo[1], -hit_.wo[2]};
            if (s.outcome == PLYWAVE_OUTCOME_SCATTERED)
                for (int k = 0; k < 3; ++k) wi[k] = s.w[0] * hit_.s[k] + s.w[1] * hit_.t[k] + s.w[2] * hit_.n[k];
            auto kind = s.outcome == PLYWAVE_OUTCOME_SCATTERED ? Sample::Scattered
                      : s.outcome == PLYWAVE_OUTCOME_STRAIGHT  ? Sample::Straight : Sample::Absorbed;
            return {kind, wi, {s.weight[0], s.weight[1], s.weight[2]}, s.pdf};
        }
      private:
        Vec local(const Vec &w) const { return {dot(w, hit_.s), dot(w, hit_.t), dot(w, hit_.n)}; }
        Hit hit_;
        PlywaveBsdf bsdf_;
    };
  private:
    static void check(PlywaveStatus status, const PlywaveError &error) {
        if (status != PLYWAVE_STATUS_OK) throw std::runtime_error(error.message);
    }
    PlywaveFabric *fabric_ = nullptr;
    PlywaveError error_ = {};
    float um_per_uv_, turn_;
};
// [/material]

// A lamp: directions within an angle of its axis, all of one radiance.
struct Lamp {
    Vec axis, x, y;
    float cosine;
    Color radiance;

    static Lamp towards(Vec axis, float angle, Color radiance) {
        float length = std::sqrt(dot(axis, axis));
        for (float &v : axis) v /= length;
        Vec x = {axis[2], 0.0f, -axis[0]};
        float across = std::sqrt(dot(x, x));
        for (float &v : x) v /= across;
        Vec y = {axis[1] * x[2] - axis[2] * x[1], axis[2] * x[0] - axis[0] * x[2], axis[0] * x[1] - axis[1] * x[0]};
        return {axis, x, y, std::cos(angle), radiance};
    }
    float pdf() const { return 1.0f / (2.0f * 3.14159265f * (1.0f - cosine)); }
    Color seen(const Vec &w) const { return dot(w, axis) >= cosine ? radiance : Color{}; }
    Vec sample(float u, float v) const {
        float z = 1.0f - u * (1.0f - cosine), r = std::sqrt(std::max(0.0f, 1.0f - z * z)), phi = 2.0f * 3.14159265f * v;
        Vec w;
        for (int k = 0; k < 3; ++k) w[k] = r * std::cos(phi) * x[k] + r * std::sin(phi) * y[k] + z * axis[k];
        return w;
    }
};

// Sums of a color and of its squares.
struct Mean {
    std::array<double, 3> sum = {}, squares = {};
    int n = 0;
    void add(const std::array<double, 3> &v) {
        for (int k = 0; k < 3; ++k) sum[k] += v[k], squares[k] += v[k] * v[k];
        ++n;
    }
    double mean(int k) const { return sum[k] / n; }
    double error(int k) const { return std::sqrt(std::max(0.0, squares[k] / n - mean(k) * mean(k)) / n); }
};

enum Strategy { ByLamp, ByMaterial, Both };

// Light that a random point of the cloth sends to the camera: one sample of a path tracer without further bounces.
static std::array<double, 3> shade(const Material &cloth, const Vec &wo, const Lamp &lamp, Strategy strategy, std::mt19937 &rng) {
    std::uniform_real_distribution<float> uniform(0.0f, 0.999999f);
    auto u = [&] { return uniform(rng); };
    // A surface that stands askew in the world: s, t, n are its frame.
    Hit hit = {{0.6f, 0.0f, -0.8f}, {0.0f, 1.0f, 0.0f}, {0.8f, 0.0f, 0.6f}, wo, {u(), u()}, 0.1f, nullptr};
    Material::Point point(cloth, hit, {u(), u()});
    std::array<double, 3> light = {};
    auto add = [&](const Color &a, const Color &b, float scale) {
        for (int k = 0; k < 3; ++k) light[k] += double(a[k]) * b[k] * scale;
    };
    if (strategy != ByMaterial) {
        Vec wi = lamp.sample(u(), u());
        float pdf = 0.0f;
        Color f = point.eval(wi, &pdf);
        float weight = strategy == Both ? lamp.pdf() / (lamp.pdf() + pdf) : 1.0f; // the balance heuristic
        add(f, lamp.radiance, weight / lamp.pdf());
    }
    auto s = point.sample({u(), u(), u()});
    if (s.kind == Material::Point::Sample::Straight) add(s.weight, lamp.seen(s.wi), 1.0f); // no other strategy finds it
    if (s.kind == Material::Point::Sample::Scattered && strategy != ByLamp)
        add(s.weight, lamp.seen(s.wi), strategy == Both ? s.pdf / (lamp.pdf() + s.pdf) : 1.0f);
    return light;
}

int main(int argc, char **argv) {
    // Light goes straight through the gaps of this organza: all three outcomes of a sample come up.
    PlywaveFabricOptions options = {};
    options.straight_gaps = 1;
    std::unique_ptr<Material> cloth;
    try {
        cloth = std::make_unique<Material>(argc > 1 ? argv[1] : "fabrics/silk_organza.toml", 50'000.0f, 0.3f, &options);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
    const Vec wo = {0.6f, 0.48f, 0.64f}; // unit
    const Lamp lamps[] = {Lamp::towards({0.9f, 0.1f, 0.3f}, 0.4f, {5.0f, 4.0f, 3.0f}),
                          Lamp::towards({-0.6f, -0.48f, -0.6f}, 0.4f, {1.0f, 1.0f, 1.0f})};
    const char *names[] = {"lit from the front", "lit from behind"};
    const char *strategies[] = {"lamp", "material", "both"};
    bool ok = true;
    for (int l = 0; l < 2; ++l) {
        Mean found[3];
        for (int s = 0; s < 3; ++s) {
            std::mt19937 rng(unsigned(10 * l + s + 1));
            for (int i = 0; i < 60'000; ++i) found[s].add(shade(*cloth, wo, lamps[l], Strategy(s), rng));
            std::printf("%-18s by %-8s", names[l], strategies[s]);
            for (int k = 0; k < 3; ++k) std::printf("  %.4f +- %.4f", found[s].mean(k), found[s].error(k));
            std::printf("\n");
        }
        for (int s = 0; s < 2; ++s)
            for (int k = 0; k < 3; ++k)
                ok = ok && std::abs(found[s].mean(k) - found[2].mean(k)) <= 5.0 * std::hypot(found[s].error(k), found[2].error(k))
                        && found[2].mean(k) > 0.0;
    }
    if (!ok) std::printf("the strategies disagree\n");

    // Four threads share one handle and give the same numbers as one.
    auto render = [&](unsigned seed) {
        std::mt19937 rng(seed);
        Mean mean;
        for (int i = 0; i < 5'000; ++i) mean.add(shade(*cloth, wo, lamps[0], Both, rng));
        return mean;
    };
    Mean alone[4], together[4];
    for (unsigned i = 0; i < 4; ++i) alone[i] = render(i);
    std::vector<std::thread> threads;
    for (unsigned i = 0; i < 4; ++i) threads.emplace_back([&, i] { together[i] = render(i); });
    for (auto &thread : threads) thread.join();
    for (int i = 0; i < 4; ++i) ok = ok && alone[i].sum == together[i].sum && alone[i].squares == together[i].squares;
    std::printf("four threads: %s\n", ok ? "as one" : "NOT as one, or the strategies disagree");
    return ok ? 0 : 1;
}
