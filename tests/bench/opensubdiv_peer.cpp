// Times OpenSubdiv on the jobs that bench.py times, through its public API alone.
//
//   g++ -O3 -march=native -std=c++14 -DNDEBUG -I SOURCE opensubdiv_peer.cpp SOURCE/opensubdiv/version.cpp
//       SOURCE/opensubdiv/{sdc,vtr,far,bfr}/*.cpp -o opensubdiv_peer
//   ./opensubdiv_peer CAGE.obj --random FILE [--irregular FILE] [--samples N] [--grid-faces N]
//
// SOURCE is a checkout of OpenSubdiv 3.6. Everything runs in double precision on one thread, surfaces
// are isolated to the default levels, and a tag "scheme" of the cage may ask for Loop. A query is
// (limit face, u, v) in Ptex numbering, a FILE has packed records of int32 face, float64 u, float64 v.
//
// Each line of standard input names a job, which is run once; what it needs is made ready before. The
// answer is a line of JSON: {"cpu": seconds, "wall": seconds, "items": number}, or {"error": why not}.
// So another program can be timed in turn with this one, under the same load of the machine. Jobs:
//
//   topology                                      uniform L1 (2, ...; mesh and points)
//   bfr precache, bfr new points                  uniform L1 with uv
//   far adaptive and patch table, far new points  uniform L1, operator
//   bfr SET ORDER, far SET ORDER                  uniform L1, points
//   bfr SET, visited by face ORDER                uniform L1, stencils
//   bfr weights, create P or +d1                  uniform L1, limit points
//   stencils, create P or +d1                     uniform L1, limit points and normals
//   stencils, apply P or +d1
//
// ORDER is P, +d1, +d2 (derivatives too) or normal (positions and unit normals); SET is random,
// sorted, irregular random, irregular sorted, grid 8 x 8, or thousand, which are the first random
// ones. "bfr uv" and "far uv" for "bfr" and "far" do the same with texture coordinates, but normals.
// "bytes" gives memory per face of Bfr's surfaces, "write FILE" P, d/du, d/dv of all random queries
// by Bfr, (n, 9) float64, and "drop" forgets all that has been made.

#include <opensubdiv/bfr/refinerSurfaceFactory.h>
#include <opensubdiv/far/patchMap.h>
#include <opensubdiv/far/patchTableFactory.h>
#include <opensubdiv/far/primvarRefiner.h>
#include <opensubdiv/far/ptexIndices.h>
#include <opensubdiv/far/stencilTableFactory.h>
#include <opensubdiv/far/topologyDescriptor.h>

#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

using namespace OpenSubdiv;

using Refiner = std::unique_ptr<Far::TopologyRefiner>;
using Surface = Bfr::Surface<double>;

const int SMOOTH_LEVEL = 2, SHARP_LEVEL = 6;
enum { P, D1, D2, NORMAL };
const char *const ORDERS[] = {"P", "+d1", "+d2", "normal"};
const int RESULTS[] = {1, 3, 6, 2};  // points or vectors of each order

template <int K>
struct Point {
    double x[K] = {};
    void Clear() { std::fill(x, x + K, 0.0); }
    void AddWithWeight(Point const &p, double w) {
        for (int k = 0; k < K; ++k) x[k] += w * p.x[k];
    }
};

using Point2 = Point<2>;
using Point3 = Point<3>;

struct Query {
    int face;  // limit face
    double u, v;
};

struct Cage {
    std::vector<Point3> points;
    std::vector<Point2> uv;
    std::vector<int> sizes, indices, uv_indices, crease_edges, corner_vertices, holes;
    std::vector<float> crease_weights, corner_weights;
    Sdc::SchemeType scheme = Sdc::SCHEME_CATMARK;
    Sdc::Options options;

    explicit Cage(std::string const &path) {
        std::ifstream file(path);
        if (!file) throw std::runtime_error("cannot read " + path);
        options.SetVtxBoundaryInterpolation(Sdc::Options::VTX_BOUNDARY_EDGE_AND_CORNER);
        options.SetFVarLinearInterpolation(Sdc::Options::FVAR_LINEAR_CORNERS_PLUS1);
        std::string line, word;
        while (std::getline(file, line)) {
            std::istringstream in(line);
            if (!(in >> word)) continue;
            if (word == "v") {
                Point3 p;
                in >> p.x[0] >> p.x[1] >> p.x[2];
                points.push_back(p);
            } else if (word == "vt") {
                Point2 p;
                in >> p.x[0] >> p.x[1];
                uv.push_back(p);
            } else if (word == "f") {
                int n = 0;
                for (; in >> word; ++n) {
                    indices.push_back(std::atoi(word.c_str()) - 1);
                    size_t slash = word.find('/');
                    if (slash != std::string::npos)
                        uv_indices.push_back(std::atoi(word.c_str() + slash + 1) - 1);
                }
                sizes.push_back(n);
            } else if (word == "t") {
                tag(in);
            }
        }
    }

    bool has_uv() const { return !uv.empty() && uv_indices.size() == indices.size(); }

    int regular_size() const { return scheme == Sdc::SCHEME_LOOP ? 3 : 4; }

    Refiner refiner(bool with_uv = false) const {
        Far::TopologyDescriptor d;
        d.numVertices = int(points.size());
        d.numFaces = int(sizes.size());
        d.numVertsPerFace = sizes.data();
        d.vertIndicesPerFace = indices.data();
        d.numCreases = int(crease_weights.size());
        d.creaseVertexIndexPairs = crease_edges.data();
        d.creaseWeights = crease_weights.data();
        d.numCorners = int(corner_weights.size());
        d.cornerVertexIndices = corner_vertices.data();
        d.cornerWeights = corner_weights.data();
        d.numHoles = int(holes.size());
        d.holeIndices = holes.data();
        Far::TopologyDescriptor::FVarChannel channel;
        if (with_uv) {
            if (!has_uv()) throw std::runtime_error("the cage has no texture coordinates");
            channel.numValues = int(uv.size());
            channel.valueIndices = uv_indices.data();
            d.numFVarChannels = 1;
            d.fvarChannels = &channel;
        }
        using Factory = Far::TopologyRefinerFactory<Far::TopologyDescriptor>;
        Refiner made(Factory::Create(d, Factory::Options(scheme, options)));
        if (!made) throw std::runtime_error("OpenSubdiv refuses this cage");
        return made;
    }

private:
    // "name integers/floats/strings", and so many of each
    void tag(std::istringstream &in) {
        std::string name, word;
        int counts[3] = {0, 0, 0};
        char slash;
        in >> name >> counts[0] >> slash >> counts[1] >> slash >> counts[2];
        std::vector<int> whole(counts[0]);
        std::vector<float> sharp(counts[1]);
        for (int &x : whole) in >> x;
        for (float &x : sharp) {  // "inf" among them
            in >> word;
            x = float(std::atof(word.c_str()));
        }
        if (counts[2]) in >> word;
        if (!in) throw std::runtime_error("cannot read tag " + name);
        int first = whole.empty() ? 0 : whole[0];
        if (name == "crease") {
            crease_edges.insert(crease_edges.end(), whole.begin(), whole.end());
            sharp.resize(whole.size() / 2, sharp.at(0));
            crease_weights.insert(crease_weights.end(), sharp.begin(), sharp.end());
        } else if (name == "corner") {
            corner_vertices.insert(corner_vertices.end(), whole.begin(), whole.end());
            sharp.resize(whole.size(), sharp.at(0));
            corner_weights.insert(corner_weights.end(), sharp.begin(), sharp.end());
        } else if (name == "hole") {
            holes.insert(holes.end(), whole.begin(), whole.end());
        } else if (name == "interpolateboundary") {  // numbered otherwise than Sdc's enumeration
            options.SetVtxBoundaryInterpolation(first == 0   ? Sdc::Options::VTX_BOUNDARY_NONE
                                                : first == 1 ? Sdc::Options::VTX_BOUNDARY_EDGE_AND_CORNER
                                                             : Sdc::Options::VTX_BOUNDARY_EDGE_ONLY);
        } else if (name == "facevaryinginterpolateboundary") {  // numbered like it
            options.SetFVarLinearInterpolation(Sdc::Options::FVarLinearInterpolation(first));
        } else if (name == "creasemethod") {
            options.SetCreasingMethod(word == "chaikin" ? Sdc::Options::CREASE_CHAIKIN
                                                        : Sdc::Options::CREASE_UNIFORM);
        } else if (name == "smoothtriangles") {
            options.SetTriangleSubdivision(word == "smooth" || first == 2 ? Sdc::Options::TRI_SUB_SMOOTH
                                                                          : Sdc::Options::TRI_SUB_CATMARK);
        } else if (name == "scheme") {
            if (word == "loop") scheme = Sdc::SCHEME_LOOP;
            else if (word != "catmull-clark") throw std::runtime_error("unknown scheme " + word);
        } else if (name != "units" && name != "up" && name != "facevaryingpropagatecorners") {
            throw std::runtime_error("unknown tag " + name);
        }
    }
};

struct Arguments {
    std::string cage, random, irregular;
    int samples = 100000, grid_faces = 100000;

    Arguments(int count, char **words) {
        for (int i = 1; i < count; ++i) {
            std::string w = words[i];
            if (w.compare(0, 2, "--") != 0) {
                cage = w;
                continue;
            }
            if (++i == count) throw std::runtime_error(w + " needs a value");
            std::string value = words[i];
            if (w == "--random") random = value;
            else if (w == "--irregular") irregular = value;
            else if (w == "--samples") samples = std::stoi(value);
            else if (w == "--grid-faces") grid_faces = std::stoi(value);
            else throw std::runtime_error("unknown option " + w);
        }
        if (cage.empty()) throw std::runtime_error("the path of a cage is missing");
    }
};

double seconds(clockid_t clock) {
    timespec t;
    clock_gettime(clock, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

double bytes_in_use() {
    auto m = mallinfo2();
    return double(m.uordblks) + double(m.hblkhd);
}

std::vector<Query> read_queries(std::string const &path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw std::runtime_error("there are no queries: cannot read '" + path + "'");
    std::vector<char> bytes((std::istreambuf_iterator<char>(file)), {});
    std::vector<Query> queries(bytes.size() / 20);
    for (size_t i = 0; i < queries.size(); ++i) {
        std::memcpy(&queries[i].face, &bytes[20 * i], 4);
        std::memcpy(&queries[i].u, &bytes[20 * i + 4], 16);
    }
    return queries;
}

// The base face of each limit face, and which of its sub-faces that is (-1: it has but one).
struct LimitFaces {
    std::vector<int> face, corner;

    explicit LimitFaces(Cage const &cage) {
        for (size_t f = 0; f < cage.sizes.size(); ++f) {
            bool regular = cage.sizes[f] == cage.regular_size();
            for (int k = 0; k < (regular ? 1 : cage.sizes[f]); ++k) {
                face.push_back(int(f));
                corner.push_back(regular ? -1 : k);
            }
        }
    }
};

// A query in the parameters of its base face.
struct BaseQuery {
    int face;
    double uv[2];
};

BaseQuery in_base_face(Query const &q, LimitFaces const &limit, Cage const &cage) {
    BaseQuery base{limit.face[q.face], {q.u, q.v}};
    if (limit.corner[q.face] >= 0) {
        Bfr::Parameterization p(cage.scheme, cage.sizes[base.face]);
        double local[2] = {q.u, q.v};
        p.ConvertNormalizedSubFaceToCoord(limit.corner[q.face], local, base.uv);
    }
    return base;
}

std::vector<Point3> const &values(Cage const &cage, Point3) { return cage.points; }
std::vector<Point2> const &values(Cage const &cage, Point2) { return cage.uv; }

// All surfaces and their patch points, in memory: of points (K = 3) or of texture coordinates (2).
template <int K>
struct Precached {
    static const int columns = K;
    std::vector<Surface> surfaces;
    std::vector<size_t> first;    // of each surface in `points`
    std::vector<double> points;   // (total, K)

    Precached(Far::TopologyRefiner const &refiner, Cage const &cage) {
        Bfr::RefinerSurfaceFactory<>::Options options;
        options.SetApproxLevelSmooth(SMOOTH_LEVEL).SetApproxLevelSharp(SHARP_LEVEL);
        options.SetDefaultFVarID(0);
        Bfr::RefinerSurfaceFactory<> factory(refiner, options);
        int n = factory.GetNumFaces();
        surfaces.resize(n);
        first.resize(n + 1, 0);
        for (int f = 0; f < n; ++f) {
            bool there = K == 3 ? factory.InitVertexSurface(f, &surfaces[f])
                                : factory.InitFaceVaryingSurface(f, &surfaces[f]);
            first[f + 1] = first[f] + (there ? surfaces[f].GetNumPatchPoints() : 0);
        }
        points.resize(K * first[n]);
        set_points(cage);
    }

    void set_points(Cage const &cage) {
        Surface::PointDescriptor each(K);
        double const *source = values(cage, Point<K>())[0].x;
        for (size_t f = 0; f < surfaces.size(); ++f)
            if (surfaces[f].IsValid())
                surfaces[f].PreparePatchPoints(source, each, &points[K * first[f]], each);
    }

    // NaN where there is no surface: in holes, and at boundaries that have none.
    template <int ORDER>
    void evaluate(BaseQuery const &q, double *out) const {
        Surface const &s = surfaces[q.face];
        if (!s.IsValid()) {
            std::fill(out, out + K * RESULTS[ORDER], std::nan(""));
            return;
        }
        double const *p = &points[K * first[q.face]];
        Surface::PointDescriptor each(K);
        if (ORDER == P) s.Evaluate(q.uv, p, each, out);
        if (ORDER == D1) s.Evaluate(q.uv, p, each, out, out + K, out + 2 * K);
        if (ORDER == D2)
            s.Evaluate(q.uv, p, each, out, out + K, out + 2 * K, out + 3 * K, out + 4 * K, out + 5 * K);
    }
};

// Adaptive refinement, its patches, a map to find them, and all their points.
template <int K>
struct Adaptive {
    static const int columns = K;
    Refiner refiner;
    std::unique_ptr<Far::PatchTable> table;
    std::unique_ptr<Far::PatchMap> map;
    std::vector<Point<K>> points;

    Adaptive(Refiner made, Cage const &cage) : refiner(std::move(made)) {
        Far::PatchTableFactory::Options options(SHARP_LEVEL);
        options.SetPatchPrecision<double>();
        options.SetFVarPatchPrecision<double>();
        options.useInfSharpPatch = true;
        options.generateLegacySharpCornerPatches = false;
        options.generateVaryingTables = false;
        options.generateFVarTables = K == 2;
        options.generateFVarLegacyLinearPatches = false;
        auto levels = options.GetRefineAdaptiveOptions();
        levels.SetSecondaryLevel(SMOOTH_LEVEL);
        refiner->RefineAdaptive(levels);
        table.reset(Far::PatchTableFactory::Create(*refiner, options));
        map.reset(new Far::PatchMap(*table));
        set_points(cage);
    }

    int of_level(int l) const {
        auto level = refiner->GetLevel(l);
        return K == 3 ? level.GetNumVertices() : level.GetNumFVarValues(0);
    }

    void set_points(Cage const &cage) {
        int total = 0;
        for (int l = 0; l <= refiner->GetMaxLevel(); ++l) total += of_level(l);
        int local = K == 3 ? table->GetNumLocalPoints() : table->GetNumLocalPointsFaceVarying();
        points.assign(total + local, Point<K>());
        auto const &given = values(cage, Point<K>());
        std::copy(given.begin(), given.end(), points.begin());
        Far::PrimvarRefinerReal<double> primvar(*refiner);
        Point<K> *source = points.data();
        for (int l = 1; l <= refiner->GetMaxLevel(); ++l) {
            Point<K> *target = source + of_level(l - 1);
            if (K == 3) primvar.Interpolate(l, source, target);
            else primvar.InterpolateFaceVarying(l, source, target, 0);
            source = target;
        }
        if (!local) return;
        auto const *stencils = K == 3 ? table->template GetLocalPointStencilTable<double>()
                                      : table->template GetLocalPointFaceVaryingStencilTable<double>();
        stencils->UpdateValues(points.data(), points.data() + total);
    }

    template <int ORDER>
    void evaluate(Query const &q, double *out) const {
        double w[6][20];
        auto const *handle = map->FindPatch(q.face, q.u, q.v);
        if (!handle) {
            std::fill(out, out + K * RESULTS[ORDER], std::nan(""));
            return;
        }
        double *d[6] = {w[0]};
        for (int k = 1; k < RESULTS[ORDER]; ++k) d[k] = w[k];
        if (K == 3) table->EvaluateBasis(*handle, q.u, q.v, d[0], d[1], d[2], d[3], d[4], d[5]);
        else
            table->EvaluateBasisFaceVarying(*handle, q.u, q.v, d[0], d[1], d[2], d[3], d[4], d[5]);
        auto ids = K == 3 ? table->GetPatchVertices(*handle) : table->GetPatchFVarValues(*handle);
        double sum[6 * K] = {0};
        for (int i = 0; i < ids.size(); ++i) {
            double const *x = points[ids[i]].x;
            for (int d = 0; d < RESULTS[ORDER]; ++d)
                for (int k = 0; k < K; ++k) sum[K * d + k] += w[d][i] * x[k];
        }
        std::copy(sum, sum + K * RESULTS[ORDER], out);
    }
};

// The product of two vectors divided by its length.
void unit_normal(double const *a, double const *b, double *m) {
    m[0] = a[1] * b[2] - a[2] * b[1];
    m[1] = a[2] * b[0] - a[0] * b[2];
    m[2] = a[0] * b[1] - a[1] * b[0];
    double length = std::sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]);
    for (int k = 0; k < 3; ++k) m[k] /= length;
}

template <int ORDER, class Engine, class Q>
void answer(Engine const &engine, Q const &q, double *out) {
    if (ORDER != NORMAL || Engine::columns != 3) {
        engine.template evaluate<ORDER == NORMAL ? D1 : ORDER>(q, out);
        return;
    }
    double jet[3 * Engine::columns];
    engine.template evaluate<D1>(q, jet);
    std::copy(jet, jet + 3, out);
    unit_normal(jet + 3, jet + 2 * Engine::columns, out + 3);
}

// Every query by `engine`, results in the order of the queries.
template <int ORDER, class Engine, class Q>
void answer_all(Engine const &engine, std::vector<Q> const &queries, double *out) {
    for (size_t i = 0; i < queries.size(); ++i)
        answer<ORDER>(engine, queries[i], out + i * Engine::columns * RESULTS[ORDER]);
}

// The same, visiting the queries face by face; ordering them (a counting sort) is part of the job.
template <int ORDER, class Engine>
void answer_by_face(Engine const &engine, std::vector<BaseQuery> const &queries, double *out) {
    std::vector<int> start(engine.surfaces.size() + 1, 0), order(queries.size());
    for (BaseQuery const &q : queries) ++start[q.face + 1];
    for (size_t f = 1; f < start.size(); ++f) start[f] += start[f - 1];
    for (size_t i = 0; i < queries.size(); ++i) order[start[queries[i].face]++] = int(i);
    for (int i : order)
        answer<ORDER>(engine, queries[i], out + size_t(i) * Engine::columns * RESULTS[ORDER]);
}

// A cage refined to some level, with its points, its stencils and, if wanted, texture coordinates.
struct Uniform {
    Refiner refiner;
    int levels = 0;
    bool with_uv, full = false;
    std::vector<std::vector<Point3>> points;
    std::vector<std::vector<Point2>> uv;
    std::unique_ptr<Far::StencilTableReal<double> const> stencils;

    Uniform(Cage const &cage, bool with_uv)
        : refiner(cage.refiner(with_uv)), with_uv(with_uv), points{cage.points}, uv{cage.uv} {}

    void coarse() {
        refiner->Unrefine();
        stencils.reset();
        levels = 0;
    }

    void refine(int l, bool full_topology) {
        Far::TopologyRefiner::UniformOptions options(l);
        options.fullTopologyInLastLevel = full_topology;
        refiner->RefineUniform(options);
        levels = l;
        full = full_topology;
    }

    void interpolate() {
        Far::PrimvarRefinerReal<double> primvar(*refiner);
        points.resize(levels + 1);
        uv.resize(levels + 1);
        for (int l = 1; l <= levels; ++l) {
            auto level = refiner->GetLevel(l);
            points[l].assign(level.GetNumVertices(), Point3());
            primvar.Interpolate(l, points[l - 1], points[l]);
            if (!with_uv) continue;
            uv[l].assign(level.GetNumFVarValues(0), Point2());
            primvar.InterpolateFaceVarying(l, uv[l - 1], uv[l], 0);
        }
    }

    void make_stencils() {
        Far::StencilTableFactoryReal<double>::Options only_last;
        only_last.generateIntermediateLevels = false;
        stencils.reset(Far::StencilTableFactoryReal<double>::Create(*refiner, only_last));
    }

    // Refined so, whatever was before.
    void ready(int l, bool full_topology) {
        if (levels == l && full == full_topology) return;
        coarse();
        refine(l, full_topology);
        interpolate();
    }
};

struct Task {
    double items = 0;
    std::function<void()> run, prepare = [] {};
};

class Bench {
public:
    explicit Bench(Arguments const &given) : args(given), cage(given.cage), limit(cage) {}

    // The line that answers one of the input.
    std::string reply(std::string const &line) {
        if (line == "drop") return drop(), "{}";
        if (line == "bytes") return line_of("bytes", bytes_per_face());
        if (line.compare(0, 6, "write ") == 0) return write(line.substr(6)), "{}";
        if (!tasks.count(line)) tasks[line] = make(line);
        Task &task = tasks[line];
        task.prepare();
        double wall = seconds(CLOCK_MONOTONIC), cpu = seconds(CLOCK_PROCESS_CPUTIME_ID);
        task.run();
        cpu = seconds(CLOCK_PROCESS_CPUTIME_ID) - cpu;
        wall = seconds(CLOCK_MONOTONIC) - wall;
        char text[200];
        std::snprintf(text, 200, "{\"cpu\": %.9g, \"wall\": %.9g, \"items\": %.17g}", cpu, wall, task.items);
        return text;
    }

private:
    Arguments args;
    Cage cage;
    LimitFaces limit;
    std::map<std::string, Task> tasks;
    std::map<std::string, std::vector<Query>> sets;
    std::unique_ptr<Precached<3>> bfr;
    std::unique_ptr<Precached<2>> bfr_uv;
    std::unique_ptr<Adaptive<3>> far;
    std::unique_ptr<Adaptive<2>> far_uv;
    std::unique_ptr<Uniform> uniform, uniform_uv;
    std::unique_ptr<Far::LimitStencilTableReal<double> const> stencils[2];
    Refiner spare;
    std::vector<double> out;

    static std::string line_of(std::string const &name, double value) {
        char text[100];
        std::snprintf(text, 100, "{\"%s\": %.17g}", name.c_str(), value);
        return text;
    }

    void drop() {
        tasks.clear();
        sets.clear();
        bfr.reset();
        bfr_uv.reset();
        far.reset();
        far_uv.reset();
        uniform.reset();
        uniform_uv.reset();
        for (auto &table : stencils) table.reset();
        spare.reset();
        out = {};
    }

    double faces() const { return double(cage.sizes.size()); }

    template <int K>
    void need(std::unique_ptr<Precached<K>> &engine) {
        if (!engine) engine.reset(new Precached<K>(*cage.refiner(K == 2), cage));
    }

    template <int K>
    void need(std::unique_ptr<Adaptive<K>> &engine) {
        if (!engine) engine.reset(new Adaptive<K>(cage.refiner(K == 2), cage));
    }

    double bytes_per_face() {
        Refiner refiner = cage.refiner();
        bfr.reset();
        double before = bytes_in_use();
        bfr.reset(new Precached<3>(*refiner, cage));
        return (bytes_in_use() - before) / faces();
    }

    void write(std::string const &path) {
        need(bfr);
        std::vector<BaseQuery> all = in_base_faces(queries("random"));
        std::vector<double> jets(9 * all.size());
        answer_all<D1>(*bfr, all, jets.data());
        std::ofstream(path, std::ios::binary)
            .write(reinterpret_cast<char const *>(jets.data()), std::streamsize(8 * jets.size()));
    }

    std::vector<Query> const &queries(std::string const &name) {
        if (!sets.count(name)) sets[name] = make_queries(name);
        return sets[name];
    }

    std::vector<Query> make_queries(std::string const &name) {
        std::vector<Query> found;
        if (name == "random") return read_queries(args.random);
        if (name == "irregular random") return read_queries(args.irregular);
        if (name == "thousand" || name == "samples") {
            found = queries("random");
            size_t most = name == "thousand" ? 1000 : size_t(args.samples);
            found.resize(std::min(found.size(), most));
        } else if (name == "sorted" || name == "irregular sorted") {
            found = queries(name == "sorted" ? "random" : "irregular random");
            std::stable_sort(found.begin(), found.end(),
                             [](Query const &a, Query const &b) { return a.face < b.face; });
        } else if (name == "grid 8 x 8") {  // the middles of so many cells of each limit face
            int n = std::min(args.grid_faces, int(limit.face.size()));
            found.reserve(64 * size_t(n));
            for (int f = 0; f < n; ++f)
                for (int i = 0; i < 8; ++i)
                    for (int j = 0; j < 8; ++j) found.push_back({f, (i + 0.5) / 8, (j + 0.5) / 8});
            if (cage.regular_size() == 3)  // into the triangle, as bench.py does
                for (Query &q : found)
                    if (q.u + q.v > 1) q = {q.face, 1 - q.u, 1 - q.v};
        } else {
            throw std::runtime_error("unknown queries " + name);
        }
        return found;
    }

    std::vector<BaseQuery> in_base_faces(std::vector<Query> const &queries) const {
        std::vector<BaseQuery> base;
        base.reserve(queries.size());
        for (Query const &q : queries) base.push_back(in_base_face(q, limit, cage));
        return base;
    }

    static bool begins(std::string const &line, std::string const &with) {
        return line.compare(0, with.size(), with) == 0;
    }

    static bool ends(std::string const &line, std::string const &with) {
        return line.size() >= with.size() &&
               line.compare(line.size() - with.size(), with.size(), with) == 0;
    }

    Task make(std::string const &line) {
        if (line == "topology") return {faces(), [=] { spare = cage.refiner(); }, [=] { spare.reset(); }};
        if (begins(line, "uniform L")) return make_uniform(line);
        if (begins(line, "stencils, ") || begins(line, "bfr weights")) return make_weights(line);
        if (begins(line, "bfr uv ")) return make_bfr(bfr_uv, line.substr(7));
        if (begins(line, "far uv ")) return make_far(far_uv, line.substr(7));
        if (begins(line, "bfr ")) return make_bfr(bfr, line.substr(4));
        if (begins(line, "far ")) return make_far(far, line.substr(4));
        throw std::runtime_error("unknown job " + line);
    }

    template <int K>
    Task make_bfr(std::unique_ptr<Precached<K>> &engine, std::string const &job) {
        if (job == "precache")
            return {faces(), [&] { engine.reset(new Precached<K>(*spare, cage)); },
                    [&] {
                        engine.reset();
                        spare = cage.refiner(K == 2);
                    }};
        need(engine);
        if (job == "new points") return {faces(), [&] { engine->set_points(cage); }};
        std::string set = job.substr(0, job.rfind(' ')), order = job.substr(job.rfind(' ') + 1);
        const std::string visited = ", visited by face";
        bool by_face = ends(set, visited);
        if (by_face) set.resize(set.size() - visited.size());
        auto all = std::make_shared<std::vector<BaseQuery>>(in_base_faces(queries(set)));
        if (order == ORDERS[P]) return by_face ? visits<P>(engine, all) : answers<P>(engine, all);
        if (order == ORDERS[D1]) return by_face ? visits<D1>(engine, all) : answers<D1>(engine, all);
        if (order == ORDERS[D2]) return by_face ? visits<D2>(engine, all) : answers<D2>(engine, all);
        if (order == ORDERS[NORMAL] && K == 3)
            return by_face ? visits<NORMAL>(engine, all) : answers<NORMAL>(engine, all);
        throw std::runtime_error("unknown order " + order);
    }

    template <int K>
    Task make_far(std::unique_ptr<Adaptive<K>> &engine, std::string const &job) {
        if (job == "adaptive and patch table")
            return {faces(), [&] { engine.reset(new Adaptive<K>(std::move(spare), cage)); },
                    [&] {
                        engine.reset();
                        spare = cage.refiner(K == 2);
                    }};
        need(engine);
        if (job == "new points") return {faces(), [&] { engine->set_points(cage); }};
        std::string set = job.substr(0, job.rfind(' ')), order = job.substr(job.rfind(' ') + 1);
        auto all = std::make_shared<std::vector<Query>>(queries(set));
        if (order == ORDERS[P]) return answers<P>(engine, all);
        if (order == ORDERS[D1]) return answers<D1>(engine, all);
        if (order == ORDERS[D2]) return answers<D2>(engine, all);
        if (order == ORDERS[NORMAL] && K == 3) return answers<NORMAL>(engine, all);
        throw std::runtime_error("unknown order " + order);
    }

    void room(size_t n) {
        if (out.size() < n) out.resize(n);
    }

    template <int ORDER, class Engine, class Q>
    Task answers(std::unique_ptr<Engine> &engine, std::shared_ptr<std::vector<Q>> all) {
        room(all->size() * Engine::columns * RESULTS[ORDER]);
        return {double(all->size()), [=, &engine] { answer_all<ORDER>(*engine, *all, out.data()); }};
    }

    template <int ORDER, class Engine>
    Task visits(std::unique_ptr<Engine> &engine, std::shared_ptr<std::vector<BaseQuery>> all) {
        room(all->size() * Engine::columns * RESULTS[ORDER]);
        return {double(all->size()), [=, &engine] { answer_by_face<ORDER>(*engine, *all, out.data()); }};
    }

    Task make_weights(std::string const &line) {
        bool derivatives = ends(line, " +d1");
        if (begins(line, "bfr weights")) return make_ready_weights(derivatives);
        std::vector<Query> const &samples = queries("samples");
        double n = double(samples.size());
        auto &table = stencils[derivatives];
        need(far);
        auto create = [=, &samples, &table] {
            using Factory = Far::LimitStencilTableFactoryReal<double>;
            Factory::LocationArrayVec where(samples.size());
            for (size_t i = 0; i < samples.size(); ++i) {
                where[i].ptexIdx = samples[i].face;
                where[i].numLocations = 1;
                where[i].s = &samples[i].u;
                where[i].t = &samples[i].v;
            }
            Factory::Options options;
            options.generate1stDerivatives = derivatives;
            table.reset(Factory::Create(*far->refiner, where, nullptr, nullptr, options));
        };
        if (begins(line, "stencils, create")) return {n, create, [&table] { table.reset(); }};
        if (!table) create();
        auto p = std::make_shared<std::vector<Point3>>(samples.size()), du = p, dv = p;
        if (derivatives) {
            du = std::make_shared<std::vector<Point3>>(samples.size());
            dv = std::make_shared<std::vector<Point3>>(samples.size());
        }
        return {n, [=, &table] {
                    table->UpdateValues(cage.points.data(), p->data());
                    if (derivatives) table->UpdateDerivs(cage.points.data(), du->data(), dv->data());
                }};
    }

    // Weights of fixed samples as rows over the cage, from ready surfaces.
    Task make_ready_weights(bool derivatives) {
        need(bfr);
        auto all = std::make_shared<std::vector<BaseQuery>>(in_base_faces(queries("samples")));
        size_t total = 0;
        for (BaseQuery const &q : *all) total += bfr->surfaces[q.face].GetNumControlPoints();
        auto indices = std::make_shared<std::vector<int>>(total);
        auto weights = std::make_shared<std::vector<double>>(3 * total);
        return {double(all->size()), [=] {
                    size_t end = 0;
                    for (BaseQuery const &q : *all) {
                        Surface const &s = bfr->surfaces[q.face];
                        if (!s.IsValid()) continue;
                        double *w = &(*weights)[3 * end];
                        int n = s.GetNumControlPoints();
                        s.GetControlPointIndices(&(*indices)[end]);
                        if (derivatives) s.EvaluateStencil(q.uv, w, w + n, w + 2 * n);
                        else s.EvaluateStencil(q.uv, w);
                        end += n;
                    }
                }};
    }

    Task make_uniform(std::string const &line) {
        size_t end = line.find_first_of(" ,", 9);
        int levels = std::stoi(line.substr(9));
        std::string what = end == std::string::npos ? "" : line.substr(end);
        auto &fine = what == " with uv" ? uniform_uv : uniform;
        if (!fine) fine.reset(new Uniform(cage, what == " with uv"));
        double corners = cage.scheme == Sdc::SCHEME_LOOP ? 4.0 / 3 : 1;  // that it has faces per corner
        double n = corners * double(cage.indices.size()) * std::pow(4, levels - 1);
        auto coarse = [&fine] { fine->coarse(); };
        auto ready = [=, &fine] { fine->ready(levels, false); };
        auto full = [=, &fine] { fine->ready(levels, true); };
        if (what.empty() || what == " with uv")
            return {n, [=, &fine] {
                        fine->refine(levels, false);
                        fine->interpolate();
                    }, coarse};
        if (what == ", operator")
            return {n, [=, &fine] {
                        fine->refine(levels, false);
                        fine->make_stencils();
                    }, coarse};
        if (what == ", points") return {n, [&fine] { fine->interpolate(); }, ready};
        if (what == ", stencils")
            return {n, [=, &fine] {
                        fine->stencils->UpdateValues(cage.points.data(), fine->points.back().data());
                    },
                    [=, &fine] {
                        ready();
                        if (!fine->stencils) fine->make_stencils();
                    }};
        auto p = std::make_shared<std::vector<Point3>>(), du = std::make_shared<std::vector<Point3>>(),
             dv = std::make_shared<std::vector<Point3>>();
        if (what == ", limit points")
            return {n, [=, &fine] {
                        p->resize(fine->points.back().size());
                        Far::PrimvarRefinerReal<double>(*fine->refiner).Limit(fine->points.back(), *p);
                    }, full};
        if (what == ", limit points and normals")
            return {n, [=, &fine] {
                        for (auto &x : {p, du, dv}) x->resize(fine->points.back().size());
                        Far::PrimvarRefinerReal<double>(*fine->refiner)
                            .Limit(fine->points.back(), *p, *du, *dv);
                        for (size_t i = 0; i < p->size(); ++i) {
                            Point3 m;
                            unit_normal((*du)[i].x, (*dv)[i].x, m.x);
                            (*du)[i] = m;
                        }
                    }, full};
        throw std::runtime_error("unknown job " + line);
    }
};

int main(int count, char **words) {
    try {
        Bench bench{Arguments(count, words)};
        for (std::string line; std::getline(std::cin, line);) {
            std::string said;
            try {
                said = bench.reply(line);
            } catch (std::exception const &error) {
                said = std::string("{\"error\": \"") + error.what() + "\"}";
            }
            std::cout << said << std::endl;
        }
    } catch (std::exception const &error) {
        std::cerr << "opensubdiv_peer: " << error.what() << "\n";
        return 1;
    }
}
