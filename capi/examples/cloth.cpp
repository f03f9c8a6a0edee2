// A renderer's material in C++17: a cloth with frames, uv, straight light through gaps, RGB and multiple importance sampling.
//
//     material CLOTH.pwc
//
// CLOTH.pwc is made by `plywave weave CLOTH.toml -o CLOTH.pwc`.
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
using Vec = std::array<float, 3>;
using Color = std::array<float, 3>; // linear sRGB
inline float dot(const Vec &a, const Vec &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

struct Hit {                      // what a renderer knows where a ray hits
    Vec s, t, n;                  // along u, along v, normal of the face: orthonormal
    Vec wo;                       // towards where the ray came from
    std::array<float, 2> uv;
    float footprint = 0.0f;       // width of the ray there, in uv; 0 is a point
    const float *sigma = nullptr; // the texel's absorptions (plywave_cloth_sigma_of_reflectance), if it has some
};

struct Sample {
    PlywaveOutcome outcome; // scattered; straight on along the ray, a delta that no lamp finds; absorbed
    Vec wi;
    Color weight;           // f / pdf
    float pdf;
};

class Material {
  public:
    // A unit of uv is `um_per_uv` large; the pattern is turned by `turn` [rad].
    Material(const char *path, float um_per_uv, float turn, const PlywaveClothOptions *options) : um_per_uv_(um_per_uv), turn_(turn) {
        PlywaveError error;
        if (plywave_cloth_load(path, options, &cloth_, &error) != PLYWAVE_STATUS_OK) throw std::runtime_error(error.message);
    }
    ~Material() { plywave_cloth_free(cloth_); }
    Material(const Material &) = delete;
    Material &operator=(const Material &) = delete;
    // Prepares a hit, in 6 KB of the caller's stack. `jitter` in [0, 1)^2 moves it within the ray's footprint: the samples of a pixel average the yarns.
    bool at(const Hit &hit, std::array<float, 2> jitter, PlywaveBsdf *bsdf) const {
        PlywaveClothQuery query = {};
        for (int k = 0; k < 2; ++k) query.position_um[k] = um_per_uv_ * (hit.uv[k] + hit.footprint * (jitter[k] - 0.5f));
        for (int k = 0; k < 3; ++k) query.wo[k] = local(hit, hit.wo)[k];
        query.count = 3;
        query.channels = PLYWAVE_CHANNELS_LINEAR_SRGB;
        query.turn_rad = turn_;
        query.sigma_warp_per_um = query.sigma_weft_per_um = hit.sigma;
        return plywave_cloth_at(cloth_, &query, bsdf, nullptr) == PLYWAVE_STATUS_OK;
    }
    // The BSDF times the cosine, and the density with which `sample` gives `wi`, for multiple importance sampling.
    static Color eval(const Hit &hit, const PlywaveBsdf &bsdf, const Vec &wi, float *pdf) {
        Color f = {};
        *pdf = 0.0f;
        plywave_bsdf_eval_pdf(&bsdf, local(hit, wi).data(), f.data(), pdf, nullptr);
        return f;
    }
    static Sample sample(const Hit &hit, const PlywaveBsdf &bsdf, const Vec &u) {
        PlywaveSample s = {};
        plywave_bsdf_sample(&bsdf, u.data(), &s, nullptr);
        Sample sample = {PlywaveOutcome(s.outcome), {-hit.wo[0], -hit.wo[1], -hit.wo[2]}, {s.weight[0], s.weight[1], s.weight[2]}, s.pdf};
        if (s.outcome == PLYWAVE_OUTCOME_SCATTERED)
            for (int k = 0; k < 3; ++k) sample.wi[k] = s.w[0] * hit.s[k] + s.w[1] * hit.t[k] + s.w[2] * hit.n[k];
        return sample;
    }
  private:
    static Vec local(const Hit &hit, const Vec &w) { return {dot(w, hit.s), dot(w, hit.t), dot(w, hit.n)}; }
    PlywaveCloth *cloth_ = nullptr;
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
    PlywaveBsdf bsdf;
    if (!cloth.at(hit, {u(), u()}, &bsdf)) std::abort();
    std::array<double, 3> light = {};
    auto add = [&](const Color &a, const Color &b, float scale) {
        for (int k = 0; k < 3; ++k) light[k] += double(a[k]) * b[k] * scale;
    };
    if (strategy != ByMaterial) {
        Vec wi = lamp.sample(u(), u());
        float pdf = 0.0f;
        Color f = Material::eval(hit, bsdf, wi, &pdf);
        float weight = strategy == Both ? lamp.pdf() / (lamp.pdf() + pdf) : 1.0f; // the balance heuristic
        add(f, lamp.radiance, weight / lamp.pdf());
    }
    Sample s = Material::sample(hit, bsdf, {u(), u(), u()});
    if (s.outcome == PLYWAVE_OUTCOME_STRAIGHT) add(s.weight, lamp.seen(s.wi), 1.0f); // no other strategy finds it
    if (s.outcome == PLYWAVE_OUTCOME_SCATTERED && strategy != ByLamp)
        add(s.weight, lamp.seen(s.wi), strategy == Both ? s.pdf / (lamp.pdf() + s.pdf) : 1.0f);
    return light;
}

int main(int argc, char **argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: material CLOTH.pwc\n");
        return 2;
    }
    // Light goes straight beside plies and through gaps: all three outcomes of a sample come up, and none of its lobes is so narrow that a lamp hardly finds it.
    PlywaveClothOptions options = {};
    options.straight_gaps = options.no_edges = 1;
    std::unique_ptr<Material> cloth;
    try {
        cloth = std::make_unique<Material>(argv[1], 50'000.0f, 0.3f, &options);
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
