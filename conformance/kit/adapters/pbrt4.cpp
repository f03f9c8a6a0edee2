// Adapter of pbrt-v4: HairBxDF, DielectricBxDF, ConductorBxDF, DiffuseBxDF, DiffuseTransmissionBxDF.
//
//     conformance/kit/adapters/build_pbrt4.sh PBRT_CHECKOUT OUT_FOLDER
//     python3 conformance/kit/conform.py OUT_FOLDER/pbrt4
//
// It links pbrt's bxdfs.cpp alone; functions of pbrt that these models reach only in an error are replaced.
// The layered models are left out: their f and PDF are estimates by random walks; the kit compares values.
#include <pbrt/bxdfs.h>
#include <pbrt/options.h>
#include <pbrt/util/error.h>
#include <pbrt/util/log.h>
#include <pbrt/util/stats.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace pbrt {
namespace detail {
// Messages are formed only of a CHECK that fails: its text without its values will do.
std::string copyToFormatString(const char **format, std::string *) { throw std::runtime_error(*format); }
void stringPrintfRecursive(std::string *text, const char *format) { *text += format; }
}  // namespace detail
void LogFatal(LogLevel, const char *file, int line, const char *text) {
    std::fprintf(stderr, "%s:%d: %s\n", file, line, text);
    std::abort();
}
StatRegisterer::StatRegisterer(AccumFunc, PixelAccumFunc) {}
void StatsAccumulator::ReportRareCheck(const char *, Float, int64_t, int64_t) {}
void StatsAccumulator::ReportMemoryCounter(const char *, int64_t) {}
}  // namespace pbrt

using namespace pbrt;

// JSON: values, arrays and objects, without escapes, which no request has.
struct Json {
    double number = 0.0;
    std::string text;
    std::vector<Json> list;
    std::map<std::string, Json> object;
    const Json &operator[](const std::string &key) const {
        auto found = object.find(key);
        if (found == object.end()) throw std::runtime_error("no " + key);
        return found->second;
    }
    Vector3f vector() const { return Vector3f(list.at(0).number, list.at(1).number, list.at(2).number); }
};

struct Reader {
    const char *at;
    char next() {
        while (*at == ' ' || *at == ',' || *at == ':') ++at;
        return *at;
    }
    std::string quoted() {
        const char *begin = ++at;
        while (*at && *at != '"') ++at;
        return std::string(begin, *at ? at++ : at);
    }
    Json value() {
        Json v;
        switch (next()) {
        case '[':
            for (++at; next() != ']';) v.list.push_back(value());
            ++at;
            break;
        case '{':
            for (++at; next() != '}';) {
                if (*at != '"') throw std::runtime_error("a key is not quoted");
                std::string key = quoted();
                v.object[key] = value();
            }
            ++at;
            break;
        case '"':
            v.text = quoted();
            break;
        default: {
            char *end;
            v.number = std::strtod(at, &end);
            if (end == at) throw std::runtime_error("not JSON");
            at = end;
        }
        }
        return v;
    }
};

std::string print(double x) {
    if (std::isnan(x)) return "NaN";
    if (std::isinf(x)) return x > 0.0 ? "Infinity" : "-Infinity";
    char text[32];
    std::snprintf(text, sizeof text, "%.9g", x);
    return text;
}

std::string print(const std::vector<double> &values) {
    std::string out = "[";
    for (double v : values) out += (out.size() > 1 ? "," : "") + print(v);
    return out + "]";
}

// Along a fiber pbrt has x, and its y and z are the cross section; a surface's normal is z, as in the kit.
struct Frame3 {
    bool fiber;
    Vector3f in(Vector3f w) const { return fiber ? Vector3f(w.z, w.x, w.y) : w; }
    Vector3f out(Vector3f w) const { return fiber ? Vector3f(w.y, w.z, w.x) : w; }
    // What makes f an energy density. HairBxDF::f has its own division by this cosine, but for one that is 0.
    Float cosine(Vector3f wi) const { return fiber && wi.z == 0 ? 1 : AbsCosTheta(wi); }
};

// The kit's wi is pbrt's wo. Importance: flux that leaves, without the eta^2 of radiance.
constexpr TransportMode mode = TransportMode::Importance;
constexpr BxDFReflTransFlags all = BxDFReflTransFlags::All;

// As pbrt's BSDF does: 0 where wo is in the surface, and no sample that lies in it.
template <typename B>
std::string answer(const B &bxdf, Frame3 frame, const Json &q) {
    std::string task = q["do"].text;
    Vector3f wo = frame.in(q["wi"].vector());
    bool none = wo.z == 0 && !frame.fiber;
    if (task == "eval" || task == "pdf") {
        std::vector<double> values;
        for (const Json &w : q["wo"].list) {
            Vector3f wi = frame.in(w.vector());
            if (none) values.push_back(0.0);
            else if (task == "pdf") values.push_back(bxdf.PDF(wo, wi, mode, all));
            else values.push_back(bxdf.f(wo, wi, mode)[0] * frame.cosine(wi));
        }
        return "{\"" + std::string(task == "pdf" ? "pdf" : "f") + "\": " + print(values) + "}";
    }
    if (task != "sample") throw std::runtime_error("do = " + task + ": use describe, eval, pdf or sample");
    std::vector<double> weight, pdf;
    std::string directions;
    for (const Json &u : q["u"].list) {
        Float uc = std::min<Float>(u.list.at(0).number, OneMinusEpsilon);
        Point2f u2(std::min<Float>(u.list.at(1).number, OneMinusEpsilon), std::min<Float>(u.list.at(2).number, OneMinusEpsilon));
        auto s = none ? pstd::optional<BSDFSample>() : bxdf.Sample_f(wo, uc, u2, mode, all);
        bool scatters = s && s->pdf != 0 && s->wi.z != 0;
        Vector3f w = scatters ? frame.out(s->wi) : Vector3f(0, 0, 1);
        weight.push_back(scatters ? s->f[0] * frame.cosine(s->wi) / s->pdf : 0.0);
        pdf.push_back(scatters ? s->pdf : 0.0);
        directions += (directions.empty() ? "" : ",") + print({w.x, w.y, w.z});
    }
    return "{\"wo\": [" + directions + "], \"weight\": " + print(weight) + ", \"pdf\": " + print(pdf) + "}";
}

SampledSpectrum gray(double x) { return SampledSpectrum(Float(x)); }

std::string answer(const Json &q) {
    const Json &p = q["parameters"];
    std::string model = q["model"].text;
    auto of = [&](const char *name) { return Float(p[name].number); };
    auto ggx = [&] { return TrowbridgeReitzDistribution(of("alpha"), of("alpha")); };
    // sigma_a is per radius, and tau is over the diameter. pbrt counts h the other way around the fiber, and
    // its x points to the root where alpha is positive.
    if (model == "HairBxDF")
        return answer(HairBxDF(-q["h"].number, of("eta"), gray(0.5 * of("tau")), of("beta_m"), of("beta_n"), Degrees(-of("alpha"))), {true}, q);
    if (model == "DielectricBxDF") return answer(DielectricBxDF(of("eta"), ggx()), {false}, q);
    if (model == "ConductorBxDF") return answer(ConductorBxDF(ggx(), gray(of("eta")), gray(of("kappa"))), {false}, q);
    if (model == "DiffuseBxDF") return answer(DiffuseBxDF(gray(of("albedo"))), {false}, q);
    if (model == "DiffuseTransmissionBxDF")
        return answer(DiffuseTransmissionBxDF(gray(of("albedo")), gray(of("transmittance"))), {false}, q);
    throw std::runtime_error("model = " + model);
}

// Claims are those of "Physically Based Rendering", 4th edition: 9.9 is Chiang's hair; 9.7 has G(wo, wi) of
// correlated heights, so that ggx_plane, which has G1(wi) G1(wo), is not claimed.
const char *DESCRIPTION = R"({"protocol": 1, "name": "pbrt-v4", "version": "VERSION", "models": [
{"name": "HairBxDF", "kind": "fiber", "fields": ["near"], "claims": ["lossless", "smooth_cylinder", "chiang", "circular"],
 "parameters": {"eta": [1.1, 2.0, 1.55], "tau": [0.0, 5.0, 0.0], "alpha": [-0.1, 0.1, 0.0], "beta_m": [0.15, 1.0, 0.3], "beta_n": [0.15, 1.0, 0.3]}},
{"name": "DielectricBxDF", "kind": "surface", "fields": ["surface"], "claims": ["circular", "reciprocal", "two_sided"],
 "parameters": {"eta": [1.3, 2.0, 1.5], "alpha": [0.1, 0.8, 0.3]}},
{"name": "ConductorBxDF", "kind": "surface", "fields": ["surface"], "claims": ["circular", "reciprocal"],
 "parameters": {"eta": [0.2, 3.0, 0.4], "kappa": [0.0, 7.0, 2.5], "alpha": [0.1, 0.8, 0.3]}},
{"name": "DiffuseBxDF", "kind": "surface", "fields": ["surface"], "claims": ["circular", "reciprocal"],
 "parameters": {"albedo": [0.0, 1.0, 0.5]}},
{"name": "DiffuseTransmissionBxDF", "kind": "surface", "fields": ["surface"], "claims": ["circular", "reciprocal", "two_sided"],
 "parameters": {"albedo": [0.0, 0.5, 0.3], "transmittance": [0.1, 0.5, 0.4]}}]})";

int main() {
    std::string line, description = DESCRIPTION;
    description.replace(description.find("VERSION"), 7, PBRT_COMMIT);
    for (std::size_t k; (k = description.find('\n')) != std::string::npos;) description[k] = ' ';
    while (std::getline(std::cin, line)) {
        try {
            Reader reader{line.c_str()};
            Json q = reader.value();
            std::cout << (q["do"].text == "describe" ? description : answer(q)) << std::endl;
        } catch (const std::exception &error) {
            std::cout << "{\"error\": \"" << error.what() << "\"}" << std::endl;
        }
    }
}
