// Times OpenSubdiv on the jobs that bench.py times, through its public API alone; prints JSON lines.
//
//   g++ -O3 -march=native -std=c++14 -DNDEBUG -I SOURCE opensubdiv_peer.cpp SOURCE/opensubdiv/version.cpp
//       SOURCE/opensubdiv/{sdc,vtr,far,bfr}/*.cpp -o opensubdiv_peer
//   ./opensubdiv_peer CAGE.obj [--queries N] [--random FILE] [--irregular FILE] [--write FILE]
//                     [--runs N] [--samples N] [--grid-faces N] [--levels N] [--max-faces N]
//                     [--only bfr | far | stencils | topology | uniform]
//
// SOURCE is a checkout of OpenSubdiv 3.6. Everything runs in double precision on one thread; each
// figure is the best of some runs. A query is (limit face, u, v) in Ptex numbering: drawn with a fixed
// seed, or read from a FILE of packed records of int32 face, float64 u, float64 v. --write takes P,
// d/du and d/dv of the random queries, (N, 9) float64. Surfaces are isolated to the default levels.

#include <opensubdiv/bfr/refinerSurfaceFactory.h>
#include <opensubdiv/far/patchMap.h>
#include <opensubdiv/far/patchTableFactory.h>
#include <opensubdiv/far/primvarRefiner.h>
#include <opensubdiv/far/ptexIndices.h>
#include <opensubdiv/far/stencilTableFactory.h>
#include <opensubdiv/far/topologyDescriptor.h>

#include <malloc.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <iostream>
#include <memory>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

using namespace OpenSubdiv;

using Refiner = std::unique_ptr<Far::TopologyRefiner>;
using Surface = Bfr::Surface<double>;

const int SMOOTH_LEVEL = 2, SHARP_LEVEL = 6;
const char *const ORDERS[] = {"P", "+d1", "+d2"};
const int CHANNELS[] = {3, 9, 18};  // of P; and both first derivatives; and the three second ones

struct Point {
    double x[3] = {0, 0, 0};
    void Clear() { x[0] = x[1] = x[2] = 0; }
    void AddWithWeight(Point const &p, double w) {
        for (int k = 0; k < 3; ++k) x[k] += w * p.x[k];
    }
};

struct Query {
    int face;  // limit face
    double u, v;
};

struct Cage {
    std::vector<Point> points;
    std::vector<int> sizes, indices, crease_edges, corner_vertices, holes;
    std::vector<float> crease_weights, corner_weights;
    Sdc::Options options;

    explicit Cage(std::string const &path) {
        std::ifstream file(path);
        if (!file) throw std::runtime_error("cannot read " + path);
        options.SetVtxBoundaryInterpolation(Sdc::Options::VTX_BOUNDARY_EDGE_AND_CORNER);
        std::string line, word;
        while (std::getline(file, line)) {
            std::istringstream in(line);
            if (!(in >> word)) continue;
            if (word == "v") {
                Point p;
                in >> p.x[0] >> p.x[1] >> p.x[2];
                points.push_back(p);
            } else if (word == "f") {
                int n = 0;
                for (; in >> word; ++n) indices.push_back(std::atoi(word.c_str()) - 1);
                sizes.push_back(n);
            } else if (word == "t") {
                tag(in);
            }
        }
    }

    Refiner refiner() const {
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
        using Factory = Far::TopologyRefinerFactory<Far::TopologyDescriptor>;
        Refiner made(Factory::Create(d, Factory::Options(Sdc::SCHEME_CATMARK, options)));
        if (!made) throw std::runtime_error("OpenSubdiv refuses this cage");
        return made;
    }

private:
    void tag(std::istringstream &in) {
        std::string name, counts;
        in >> name >> counts;
        int a, b;
        float s;
        if (name == "crease" && in >> a >> b >> s) {
            crease_edges.insert(crease_edges.end(), {a, b});
            crease_weights.push_back(s);
        } else if (name == "corner" && in >> a >> s) {
            corner_vertices.push_back(a);
            corner_weights.push_back(s);
        } else if (name == "hole" && in >> a) {
            holes.push_back(a);
        } else if (name == "interpolateboundary" && in >> a) {
            options.SetVtxBoundaryInterpolation(Sdc::Options::VtxBoundaryInterpolation(a));
        } else {
            throw std::runtime_error("unknown tag " + name);
        }
    }
};

struct Arguments {
    std::string cage, random, irregular, write, only;
    int queries = 1000000, runs = 5, samples = 100000, grid_faces = 200000, levels = 3;
    long max_faces = 20000000;

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
            else if (w == "--write") write = value;
            else if (w == "--only") only = value;
            else if (w == "--queries") queries = std::stoi(value);
            else if (w == "--runs") runs = std::stoi(value);
            else if (w == "--samples") samples = std::stoi(value);
            else if (w == "--grid-faces") grid_faces = std::stoi(value);
            else if (w == "--levels") levels = std::stoi(value);
            else if (w == "--max-faces") max_faces = std::stol(value);
            else throw std::runtime_error("unknown option " + w);
        }
        if (cage.empty()) throw std::runtime_error("the path of a cage is missing");
    }
};

// CPU time, which on one thread is what passes on a machine that is not shared.
double now() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

// Best time of some runs, in seconds. What `prepare` does before each run is not timed.
template <class Prepare, class Job>
double best(int runs, Prepare prepare, Job job) {
    double least = 1e300;
    for (int i = 0; i < runs; ++i) {
        prepare();
        double start = now();
        job();
        least = std::min(least, now() - start);
    }
    return least;
}

template <class Job>
double best(int runs, Job job) {
    return best(runs, [] {}, job);
}

void print(std::string const &job, std::string const &order, double seconds, double items,
           std::string const &per) {
    std::printf("{\"job\": \"%s\", \"order\": \"%s\", \"ns\": %.6g, \"per\": \"%s\"}\n", job.c_str(),
                order.c_str(), seconds / items * 1e9, per.c_str());
    std::fflush(stdout);
}

void print(std::string const &name, double value) {
    std::printf("{\"%s\": %.17g}\n", name.c_str(), value);
    std::fflush(stdout);
}

double peak_bytes() {
    rusage r;
    getrusage(RUSAGE_SELF, &r);
    return 1024.0 * double(r.ru_maxrss);
}

double bytes_in_use() {
    auto m = mallinfo2();
    return double(m.uordblks) + double(m.hblkhd);
}

std::vector<Query> read_queries(std::string const &path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw std::runtime_error("cannot read " + path);
    std::vector<char> bytes((std::istreambuf_iterator<char>(file)), {});
    std::vector<Query> queries(bytes.size() / 20);
    for (size_t i = 0; i < queries.size(); ++i) {
        std::memcpy(&queries[i].face, &bytes[20 * i], 4);
        std::memcpy(&queries[i].u, &bytes[20 * i + 4], 16);
    }
    return queries;
}

std::vector<Query> draw_queries(int n, std::vector<int> const &faces, unsigned seed) {
    std::mt19937_64 generator(seed);
    std::uniform_int_distribution<size_t> face(0, faces.size() - 1);
    std::uniform_real_distribution<double> unit(0, 1);
    std::vector<Query> queries(n);
    for (Query &q : queries) {
        q.face = faces[face(generator)];
        q.u = unit(generator);
        q.v = unit(generator);
    }
    return queries;
}

std::vector<Query> sorted_by_face(std::vector<Query> queries) {
    std::stable_sort(queries.begin(), queries.end(),
                     [](Query const &a, Query const &b) { return a.face < b.face; });
    return queries;
}

// The base face of each limit face, and which of its sub-faces that is (-1: the face is a quad).
struct LimitFaces {
    std::vector<int> face, corner;

    explicit LimitFaces(Cage const &cage) {
        for (size_t f = 0; f < cage.sizes.size(); ++f) {
            bool quad = cage.sizes[f] == 4;
            for (int k = 0; k < (quad ? 1 : cage.sizes[f]); ++k) {
                face.push_back(int(f));
                corner.push_back(quad ? -1 : k);
            }
        }
    }
};

// A query in the parameters of its base face.
struct BaseQuery {
    int face;
    double uv[2];
};

BaseQuery in_base_face(Query const &q, LimitFaces const &limit) {
    BaseQuery base{limit.face[q.face], {q.u, q.v}};
    if (limit.corner[q.face] >= 0) {
        int last = q.face, size = 0;
        while (last < int(limit.face.size()) && limit.face[last] == base.face) ++last;
        size = limit.corner[last - 1] + 1;
        Bfr::Parameterization p(Sdc::SCHEME_CATMARK, size);
        double local[2] = {q.u, q.v};
        p.ConvertNormalizedSubFaceToCoord(limit.corner[q.face], local, base.uv);
    }
    return base;
}

// All surfaces and their patch points, in memory.
struct Precached {
    std::vector<Surface> surfaces;
    std::vector<size_t> first;    // of each surface in `points`
    std::vector<double> points;   // (total, 3)

    Precached(Far::TopologyRefiner const &refiner, Cage const &cage) {
        Bfr::RefinerSurfaceFactory<>::Options options;
        options.SetApproxLevelSmooth(SMOOTH_LEVEL).SetApproxLevelSharp(SHARP_LEVEL);
        Bfr::RefinerSurfaceFactory<> factory(refiner, options);
        int n = factory.GetNumFaces();
        surfaces.resize(n);
        first.resize(n + 1, 0);
        for (int f = 0; f < n; ++f) {
            bool there = factory.InitVertexSurface(f, &surfaces[f]);
            first[f + 1] = first[f] + (there ? surfaces[f].GetNumPatchPoints() : 0);
        }
        points.resize(3 * first[n]);
        set_points(cage);
    }

    void set_points(Cage const &cage) {
        Surface::PointDescriptor three(3);
        for (size_t f = 0; f < surfaces.size(); ++f)
            if (surfaces[f].IsValid())
                surfaces[f].PreparePatchPoints(cage.points[0].x, three, &points[3 * first[f]], three);
    }

    template <int ORDER>
    void evaluate(BaseQuery const &q, double *out) const {
        Surface const &s = surfaces[q.face];
        double const *p = &points[3 * first[q.face]];
        Surface::PointDescriptor three(3);
        if (ORDER == 0) s.Evaluate(q.uv, p, three, out);
        if (ORDER == 1) s.Evaluate(q.uv, p, three, out, out + 3, out + 6);
        if (ORDER == 2)
            s.Evaluate(q.uv, p, three, out, out + 3, out + 6, out + 9, out + 12, out + 15);
    }
};

// Adaptive refinement, its patches, a map to find them, and all their points.
struct Adaptive {
    Refiner refiner;
    std::unique_ptr<Far::PatchTable> table;
    std::unique_ptr<Far::PatchMap> map;
    std::vector<Point> points;

    Adaptive(Refiner made, Cage const &cage) : refiner(std::move(made)) {
        Far::PatchTableFactory::Options options(SHARP_LEVEL);
        options.SetPatchPrecision<double>();
        options.useInfSharpPatch = true;
        options.generateLegacySharpCornerPatches = false;
        options.generateVaryingTables = false;
        auto levels = options.GetRefineAdaptiveOptions();
        levels.SetSecondaryLevel(SMOOTH_LEVEL);
        refiner->RefineAdaptive(levels);
        table.reset(Far::PatchTableFactory::Create(*refiner, options));
        map.reset(new Far::PatchMap(*table));
        set_points(cage);
    }

    void set_points(Cage const &cage) {
        points.assign(refiner->GetNumVerticesTotal() + table->GetNumLocalPoints(), Point());
        std::copy(cage.points.begin(), cage.points.end(), points.begin());
        Far::PrimvarRefinerReal<double> primvar(*refiner);
        Point *source = points.data();
        for (int l = 1; l <= refiner->GetMaxLevel(); ++l) {
            Point *target = source + refiner->GetLevel(l - 1).GetNumVertices();
            primvar.Interpolate(l, source, target);
            source = target;
        }
        if (table->GetNumLocalPoints())
            table->GetLocalPointStencilTable<double>()->UpdateValues(
                points.data(), points.data() + refiner->GetNumVerticesTotal());
    }

    template <int ORDER>
    void evaluate(Query const &q, double *out) const {
        double w[6][20];
        auto const *handle = map->FindPatch(q.face, q.u, q.v);
        if (ORDER == 0) table->EvaluateBasis(*handle, q.u, q.v, w[0]);
        if (ORDER == 1) table->EvaluateBasis(*handle, q.u, q.v, w[0], w[1], w[2]);
        if (ORDER == 2) table->EvaluateBasis(*handle, q.u, q.v, w[0], w[1], w[2], w[3], w[4], w[5]);
        auto vertices = table->GetPatchVertices(*handle);
        double sum[18] = {0};
        for (int i = 0; i < vertices.size(); ++i) {
            double const *x = points[vertices[i]].x;
            for (int d = 0; d < CHANNELS[ORDER] / 3; ++d)
                for (int k = 0; k < 3; ++k) sum[3 * d + k] += w[d][i] * x[k];
        }
        std::copy(sum, sum + CHANNELS[ORDER], out);
    }
};

// Every query by `engine`, results in the order of the queries.
template <int ORDER, class Engine, class Q>
void evaluate_all(Engine const &engine, std::vector<Q> const &queries, double *out) {
    for (size_t i = 0; i < queries.size(); ++i)
        engine.template evaluate<ORDER>(queries[i], out + i * CHANNELS[ORDER]);
}

// The same, visiting the queries face by face; ordering them (a counting sort) is part of the job.
template <int ORDER>
void evaluate_by_face(Precached const &engine, std::vector<BaseQuery> const &queries, double *out) {
    std::vector<int> start(engine.surfaces.size() + 1, 0), order(queries.size());
    for (BaseQuery const &q : queries) ++start[q.face + 1];
    for (size_t f = 1; f < start.size(); ++f) start[f] += start[f - 1];
    for (size_t i = 0; i < queries.size(); ++i) order[start[queries[i].face]++] = int(i);
    for (int i : order) engine.template evaluate<ORDER>(queries[i], out + size_t(i) * CHANNELS[ORDER]);
}

class Bench {
public:
    explicit Bench(Arguments const &given) : args(given), cage(given.cage), limit(cage) {
        print("faces", double(cage.sizes.size()));
        print("limit faces", double(limit.face.size()));
    }

    void run() {
        if (wanted("topology")) topology();
        if (wanted("uniform")) uniform();
        if (wanted("bfr")) bfr();
        if (wanted("far")) far();
        if (wanted("stencils")) stencils();
        print("peak bytes", peak_bytes());
    }

private:
    Arguments args;
    Cage cage;
    LimitFaces limit;

    bool wanted(std::string const &job) const { return args.only.empty() || args.only == job; }

    std::vector<Query> random() const {
        if (!args.random.empty()) return read_queries(args.random);
        std::vector<int> all(limit.face.size());
        for (size_t i = 0; i < all.size(); ++i) all[i] = int(i);
        return draw_queries(args.queries, all, 1);
    }

    std::vector<Query> irregular() const {
        if (!args.irregular.empty()) return read_queries(args.irregular);
        Refiner refiner = cage.refiner();
        Bfr::RefinerSurfaceFactory<> factory(*refiner);
        std::vector<int> some;
        for (size_t i = 0; i < limit.face.size(); ++i) {
            Surface s;
            if (factory.InitVertexSurface(limit.face[i], &s) && !s.IsRegular()) some.push_back(int(i));
        }
        print("irregular limit faces", double(some.size()));
        return some.empty() ? std::vector<Query>() : draw_queries(args.queries, some, 2);
    }

    std::vector<BaseQuery> in_base_faces(std::vector<Query> const &queries) const {
        std::vector<BaseQuery> base;
        base.reserve(queries.size());
        for (Query const &q : queries) base.push_back(in_base_face(q, limit));
        return base;
    }

    // P, d/du, d/dv of all queries, (n, 9); prints sums, for a look.
    template <class Engine, class Q>
    std::vector<double> checked(std::string const &name, Engine const &engine,
                                std::vector<Q> const &queries) {
        std::vector<double> out(9 * queries.size());
        evaluate_all<1>(engine, queries, out.data());
        double position = 0, derivative = 0;
        for (size_t i = 0; i < out.size(); ++i) (i % 9 < 3 ? position : derivative) += out[i];
        print(name + " sum of P", position);
        print(name + " sum of derivatives", derivative);
        return out;
    }

    template <int ORDER, class Engine, class Q>
    void time_queries(std::string const &job, Engine const &engine, std::vector<Q> const &queries) {
        if (queries.empty()) return;
        std::vector<double> out(queries.size() * CHANNELS[ORDER]);
        double s = best(args.runs, [&] { evaluate_all<ORDER>(engine, queries, out.data()); });
        print(job, ORDERS[ORDER], s, double(queries.size()), "query");
    }

    template <class Engine, class Q>
    void time_orders(std::string const &job, Engine const &engine, std::vector<Q> const &queries) {
        time_queries<0>(job, engine, queries);
        time_queries<1>(job, engine, queries);
        time_queries<2>(job, engine, queries);
    }

    void bfr() {
        Refiner refiner = cage.refiner();
        double before = bytes_in_use();
        std::unique_ptr<Precached> engine;
        double s = best(std::min(args.runs, 3), [&] { engine.reset(); },
                        [&] { engine.reset(new Precached(*refiner, cage)); });
        print("bfr precache", "", s, double(cage.sizes.size()), "face");
        s = best(args.runs, [&] { engine->set_points(cage); });
        print("bfr new points", "", s, double(cage.sizes.size()), "face");
        print("bfr bytes per face", (bytes_in_use() - before) / double(cage.sizes.size()));

        std::vector<BaseQuery> queries = in_base_faces(random());
        std::vector<double> jets = checked("bfr", *engine, queries);
        if (!args.write.empty())
            std::ofstream(args.write, std::ios::binary)
                .write(reinterpret_cast<char const *>(jets.data()), std::streamsize(8 * jets.size()));
        time_orders("bfr random", *engine, queries);
        {
            std::vector<double> out(18 * queries.size());
            std::string job = "bfr random, visited by face";
            auto print_order = [&](int order, double s) {
                print(job, ORDERS[order], s, double(queries.size()), "query");
            };
            print_order(0, best(args.runs, [&] { evaluate_by_face<0>(*engine, queries, out.data()); }));
            print_order(1, best(args.runs, [&] { evaluate_by_face<1>(*engine, queries, out.data()); }));
            print_order(2, best(args.runs, [&] { evaluate_by_face<2>(*engine, queries, out.data()); }));
        }
        time_orders("bfr sorted", *engine, in_base_faces(sorted_by_face(random())));
        std::vector<Query> odd = irregular();
        time_orders("bfr irregular random", *engine, in_base_faces(odd));
        time_orders("bfr irregular sorted", *engine, in_base_faces(sorted_by_face(odd)));
        time_normals("bfr grid 8 x 8", *engine, in_base_faces(grid_queries()));
        time_normals("bfr random", *engine, queries);
        bfr_weights(*engine, queries);
    }

    // Positions and unit normals on 8 x 8 parameters of each limit face.
    std::vector<Query> grid_queries() const {
        int n = std::min(args.grid_faces, int(limit.face.size()));
        std::vector<Query> queries;
        queries.reserve(64 * size_t(n));
        for (int f = 0; f < n; ++f)
            for (int i = 0; i < 8; ++i)
                for (int j = 0; j < 8; ++j) queries.push_back({f, (i + 0.5) / 8, (j + 0.5) / 8});
        return queries;
    }

    template <class Engine, class Q>
    void time_normals(std::string const &job, Engine const &engine, std::vector<Q> const &queries) {
        std::vector<double> out(6 * queries.size());
        double s = best(args.runs, [&] {
            for (size_t i = 0; i < queries.size(); ++i) {
                double j[9], *p = &out[6 * i], *m = p + 3;
                engine.template evaluate<1>(queries[i], j);
                std::copy(j, j + 3, p);
                double const *a = j + 3, *b = j + 6;
                m[0] = a[1] * b[2] - a[2] * b[1];
                m[1] = a[2] * b[0] - a[0] * b[2];
                m[2] = a[0] * b[1] - a[1] * b[0];
                double length = std::sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]);
                for (int k = 0; k < 3; ++k) m[k] /= length;
            }
        });
        print(job, "normal", s, double(queries.size()), "query");
    }

    // Weights of fixed samples as rows over the cage, from ready surfaces.
    void bfr_weights(Precached const &engine, std::vector<BaseQuery> queries) {
        queries.resize(std::min(queries.size(), size_t(args.samples)));
        int most = 0;
        for (Surface const &s : engine.surfaces) most = std::max(most, s.GetNumControlPoints());
        std::vector<int> indices(queries.size() * most);
        std::vector<double> weights(3 * queries.size() * most);
        auto job = [&](bool derivatives) {
            size_t end = 0;
            for (BaseQuery const &q : queries) {
                Surface const &s = engine.surfaces[q.face];
                double *w = &weights[3 * end];
                int n = s.GetNumControlPoints();
                s.GetControlPointIndices(&indices[end]);
                if (derivatives)
                    s.EvaluateStencil(q.uv, w, w + n, w + 2 * n);
                else
                    s.EvaluateStencil(q.uv, w);
                end += n;
            }
        };
        double s = best(args.runs, [&] { job(false); });
        print("bfr weights, create", "P", s, double(queries.size()), "query");
        s = best(args.runs, [&] { job(true); });
        print("bfr weights, create", "+d1", s, double(queries.size()), "query");
    }

    void far() {
        std::unique_ptr<Adaptive> engine;
        Refiner refiner;
        double s = best(std::min(args.runs, 3),
                        [&] {
                            engine.reset();
                            refiner = cage.refiner();
                        },
                        [&] { engine.reset(new Adaptive(std::move(refiner), cage)); });
        print("far adaptive and patch table", "", s, double(cage.sizes.size()), "face");
        s = best(args.runs, [&] { engine->set_points(cage); });
        print("far new points", "", s, double(cage.sizes.size()), "face");
        checked("far", *engine, random());
        time_orders("far random", *engine, random());
        time_orders("far sorted", *engine, sorted_by_face(random()));
        std::vector<Query> odd = irregular();
        time_orders("far irregular random", *engine, odd);
        time_orders("far irregular sorted", *engine, sorted_by_face(odd));
        time_normals("far grid 8 x 8", *engine, grid_queries());
        time_normals("far random", *engine, random());
    }

    void stencils() {
        std::vector<Query> samples = random();
        samples.resize(std::min(samples.size(), size_t(args.samples)));
        using Factory = Far::LimitStencilTableFactoryReal<double>;
        Factory::LocationArrayVec where(samples.size());
        for (size_t i = 0; i < samples.size(); ++i) {
            where[i].ptexIdx = samples[i].face;
            where[i].numLocations = 1;
            where[i].s = &samples[i].u;
            where[i].t = &samples[i].v;
        }
        Adaptive adaptive(cage.refiner(), cage);
        Factory::Options options;
        std::unique_ptr<Far::LimitStencilTableReal<double> const> table;
        std::string order[] = {"P", "+d1"};
        double n = double(samples.size());
        int runs = std::min(args.runs, 2);
        for (int derivatives = 0; derivatives < 2; ++derivatives) {
            options.generate1stDerivatives = derivatives;
            double s = best(runs, [&] { table.reset(); },
                            [&] { table.reset(Factory::Create(*adaptive.refiner, where, nullptr,
                                                              nullptr, options)); });
            print("stencils, create", order[derivatives], s, n, "query");
        }
        std::vector<Point> p(samples.size()), du(p), dv(p);
        double s = best(args.runs, [&] { table->UpdateValues(cage.points.data(), p.data()); });
        print("stencils, apply", order[0], s, n, "query");
        s = best(args.runs, [&] {
            table->UpdateValues(cage.points.data(), p.data());
            table->UpdateDerivs(cage.points.data(), du.data(), dv.data());
        });
        print("stencils, apply", order[1], s, n, "query");
    }

    void topology() {
        Refiner refiner;
        double s = best(std::min(args.runs, 3), [&] { refiner.reset(); },
                        [&] { refiner = cage.refiner(); });
        print("topology", "", s, double(cage.sizes.size()), "face");
    }

    void uniform() {
        Refiner refiner = cage.refiner();
        for (int levels = 1; levels <= args.levels; ++levels) {
            double fine = double(cage.indices.size()) * std::pow(4, levels - 1);
            if (fine <= double(args.max_faces)) uniform(*refiner, levels, fine);
        }
    }

    void uniform(Far::TopologyRefiner &refiner, int levels, double fine) {
        std::string name = "uniform L" + std::to_string(levels);
        int runs = fine > 2e6 ? std::min(args.runs, 2) : args.runs;
        Far::TopologyRefiner::UniformOptions options(levels);
        double topology = best(runs, [&] { refiner.Unrefine(); },
                               [&] { refiner.RefineUniform(options); });
        print(name + ", topology", "", topology, fine, "output face");

        std::vector<std::vector<Point>> points{cage.points};
        for (int l = 1; l <= levels; ++l) points.emplace_back(refiner.GetLevel(l).GetNumVertices());
        Far::PrimvarRefinerReal<double> primvar(refiner);
        double s = best(runs, [&] {
            for (int l = 1; l <= levels; ++l) {
                for (Point &p : points[l]) p.Clear();
                Point *target = points[l].data();
                primvar.Interpolate(l, points[l - 1].data(), target);
            }
        });
        print(name + ", points", "", s, fine, "output face");
        print(name + ", topology and points", "", topology + s, fine, "output face");

        if (fine <= 8e6) {
            Far::StencilTableFactoryReal<double>::Options only_last;
            only_last.generateIntermediateLevels = false;
            std::unique_ptr<Far::StencilTableReal<double> const> table;
            s = best(runs, [&] { table.reset(); },
                     [&] { table.reset(Far::StencilTableFactoryReal<double>::Create(refiner, only_last)); });
            print(name + ", stencils, create", "", s, fine, "output face");
            std::vector<Point> &last = points.back();
            s = best(runs, [&] { table->UpdateValues(cage.points.data(), last.data()); });
            print(name + ", stencils, apply", "", s, fine, "output face");
        }

        options.fullTopologyInLastLevel = true;
        refiner.Unrefine();
        refiner.RefineUniform(options);
        std::vector<Point> p(points.back().size()), du(p), dv(p);
        s = best(runs, [&] { primvar.Limit(points.back(), p, du, dv); });
        print(name + ", limit positions and tangents", "", s, fine, "output face");
        refiner.Unrefine();
    }
};

int main(int count, char **words) {
    try {
        Bench(Arguments(count, words)).run();
    } catch (std::exception const &error) {
        std::cerr << "opensubdiv_peer: " << error.what() << "\n";
        return 1;
    }
}
