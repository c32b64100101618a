// Rays through samples by OpenVDB: the surface of a level set, or the first active voxel.
//
// SPDX-License-Identifier: GPL-3.0-or-later
#include <openvdb/math/DDA.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>
#include <openvdb/tools/RayIntersector.h>

#include <cstdint>
#include <exception>
#include <limits>
#include <memory>

using openvdb::Coord;
using openvdb::FloatGrid;
using Tree = FloatGrid::TreeType;
constexpr int TOP = Tree::RootNodeType::ChildNodeType::LEVEL;
using Ray = openvdb::math::Ray<double>;
using Surface = openvdb::tools::LevelSetRayIntersector<
    FloatGrid, openvdb::tools::LinearSearchImpl<FloatGrid, 0, double>, TOP, Ray>;

namespace
{
struct Subject {
    FloatGrid::Ptr grid;
    std::unique_ptr<Surface> surface; // none: its active voxels are what rays meet
};

// Where a ray comes into the first active voxel: what LevelSetHDDA asks of a search.
class FirstVoxel
{
  public:
    using RayT = Ray;

    FirstVoxel(const FloatGrid &grid, const Ray &ray) : voxels(grid.getConstAccessor()), part(ray)
    {
    }
    const Ray &ray() const
    {
        return part;
    }
    void setRange(double begin, double end)
    {
        part.setTimes(begin, end);
    }
    void init(double begin)
    {
        entry = begin;
    }
    template <typename Node> bool hasNode(const Coord &at)
    {
        return voxels.probeConstNode<Node>(at) != nullptr;
    }
    bool operator()(const Coord &at, double next)
    {
        if (voxels.isValueOn(at))
            return true;
        entry = next;
        return false;
    }
    double entry = 0.0;

  private:
    FloatGrid::ConstAccessor voxels;
    Ray part;
};
} // namespace

// Of values (nz, ny, nx), the first at index (low, low, low), those that are not `outside` are
// active: distances to a surface, or, with `cells`, anything. NULL where OpenVDB refuses it.
extern "C" void *begin(const float *values, const int32_t size[3], int32_t low, float outside,
                       int32_t cells)
try {
    openvdb::initialize();
    auto subject = std::make_unique<Subject>();
    subject->grid = FloatGrid::create(outside);
    const Coord first(low, low, low);
    const openvdb::CoordBBox box(first, first + Coord(size[0] - 1, size[1] - 1, size[2] - 1));
    const openvdb::tools::Dense<const float, openvdb::tools::LayoutXYZ> dense(box, values);
    openvdb::tools::copyFromDense(dense, *subject->grid, 0.0f);
    if (cells == 0) {
        subject->grid->setGridClass(openvdb::GRID_LEVEL_SET);
        subject->surface = std::make_unique<Surface>(*subject->grid);
    }
    return subject.release();
} catch (const std::exception &) {
    return nullptr;
}

extern "C" void finish(void *subject)
{
    delete static_cast<Subject *>(subject);
}

// Trace n rays with unit directions, (n, 3) both; t (n), infinity on a miss, and normals (n, 3) of
// surfaces.
extern "C" void trace(void *of, const double *origins, const double *directions, int64_t n,
                      double *t, double *normals)
{
    auto *subject = static_cast<Subject *>(of);
    const FloatGrid &grid = *subject->grid;
    const openvdb::CoordBBox bounds = grid.evalActiveVoxelBoundingBox();
    const openvdb::BBoxd box(bounds.min().asVec3d(), (bounds.max() + Coord(1, 1, 1)).asVec3d());
    for (int64_t i = 0; i < n; i++) {
        const double *o = origins + 3 * i, *d = directions + 3 * i;
        Ray ray(Ray::Vec3Type(o[0], o[1], o[2]), Ray::Vec3Type(d[0], d[1], d[2]));
        t[i] = std::numeric_limits<double>::infinity();
        if (subject->surface) {
            Ray::Vec3Type at, normal;
            double time = 0.0;
            if (!subject->surface->intersectsWS(ray, at, normal, time))
                continue;
            t[i] = time;
            for (int a = 0; a < 3; a++)
                normals[3 * i + a] = normal[a];
        } else if (ray.clip(box)) {
            FirstVoxel search(grid, ray);
            if (openvdb::math::LevelSetHDDA<Tree, TOP>::test(search))
                t[i] = search.entry;
        }
    }
}
