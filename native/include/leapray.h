/* LeapRay: rays through sampled volumes. The whole public C interface.
 *
 * Words: a sample is an occupancy 0..1 on a lattice point; a cell is the cube
 * between eight samples; T is the threshold at which the field f of the samples,
 * trilinear unless said otherwise, has its surface. Sample (i, j, k) lies at index coordinates
 * (i, j, k); cell (i, j, k) spans i..i+1. Outside the lattice lies one virtual
 * layer of samples of value 0, so that cut data is capped: n samples make
 * cells -1..n-1. Triples are in x, y, z order. Matrices are 4x4, row-major,
 * affine, and act on column vectors.
 *
 * Every function is re-entrant; nothing is global. A handle may be read by
 * any number of threads; calls that change it need it alone, but for
 * lr_voxelize_part, whose parts may run side by side. A function that returns
 * lr_status writes one sentence into *error when it fails (error may be NULL)
 * and makes no handle; arrays that it was filling are then undefined. LR_E_STOPPED comes
 * only of a call whose watch says stop. The header is kept plain: the ctypes declarations in
 * leapray/_abi.py are generated from it, with the limits. An enum's members stand in the
 * order of menus, and the comment behind a member is what a menu says of it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LEAPRAY_H
#define LEAPRAY_H

#include <stdint.h>

#define LR_VERSION "0.1.0"
#define LR_ABI     41 /* raised whenever a struct or a signature below changes */

#ifndef LR_API
#define LR_API __attribute__((visibility("default")))
#endif

/* ---- status ------------------------------------------------------------ */

typedef enum lr_status {
    LR_OK = 0,
    LR_E_ARGUMENT = 1, /* an argument out of its range */
    LR_E_SIZE = 2,     /* more than the format or the given buffer holds */
    LR_E_MEMORY = 3,   /* the system gave no memory */
    LR_E_STOPPED = 4   /* the caller's stop word was set */
} lr_status;

typedef struct lr_error {
    char text[480]; /* one sentence, UTF-8, NUL-terminated */
} lr_error;

/* How a long call is watched; any member, and the pointer itself, may be NULL. */
typedef struct lr_watch {
    const volatile int32_t *stop; /* nonzero: end within 100 ms with LR_E_STOPPED */
    volatile double *progress;    /* the call writes the share done, 0..1 */
} lr_watch;

LR_API int32_t lr_abi(void);         /* LR_ABI of the library */
LR_API const char *lr_version(void); /* LR_VERSION of the library */

/* ---- volumes ----------------------------------------------------------- */

/* Whole numbers mean 0..1, of LR_U8 0..255, of LR_U16 0..65535. */
typedef enum lr_sample_type {
    LR_U8 = 0,  /* one byte per sample: smallest, for previews */
    LR_U16 = 1, /* two bytes per sample: as good as exact for most scenes */
    LR_F32 = 2  /* four bytes per sample: for measurements */
} lr_sample_type;

/* LR_KIND_AUTO is for lr_voxelize_begin: see lr_reason. A sheet is valid in touched cells only. */
typedef enum lr_kind {
    LR_KIND_AUTO = 0,  /* a solid where the mesh is closed, a sheet where it is open */
    LR_KIND_SOLID = 1, /* what the mesh encloses */
    LR_KIND_SHEET = 2  /* the surface alone, without an inside */
} lr_kind;

/* The field between the samples: B-splines of degree 1 and 3. The cubic one takes the samples for
 * its coefficients: it smooths them, and reaches two samples beyond the lattice. Its volumes have
 * neither ids nor planes of their own, and are for LR_MODE_SURFACE. */
typedef enum lr_volume_interpolation {
    LR_VOLUME_LINEAR = 0, /* trilinear: passes through the samples, and bends at the faces of cells
                           */
    LR_VOLUME_CUBIC = 1 /* tricubic B-spline: smooth, without facets; rounds what is as fine as the
                           samples, and takes longer */
} lr_volume_interpolation;

typedef struct lr_volume lr_volume;

typedef struct lr_volume_desc {
    int32_t nx, ny, nz;           /* samples per axis, at least 1 */
    int32_t sample_type;          /* lr_sample_type */
    int32_t kind;                 /* LR_KIND_SOLID or LR_KIND_SHEET */
    int32_t has_ids;              /* nonzero: every sample carries a 16-bit id */
    int32_t interpolation;        /* lr_volume_interpolation */
    int32_t reserved;             /* 0 */
    double threshold;             /* T, outside < T <= inside */
    double object_from_index[16]; /* invertible */
    double outside, inside;       /* 0 and 1; of LR_F32 any: what samples are outside the lattice,
                                     and in bricks inside that take no memory */
} lr_volume_desc;

typedef struct lr_volume_info {
    lr_volume_desc desc;            /* as it was given */
    uint64_t n_bricks;              /* bricks of 8^3 samples that are stored */
    uint64_t n_full;                /* bricks that are 1 throughout and not stored */
    uint64_t n_surface_cells;       /* what rays are tested in */
    uint64_t n_triangle_cells;      /* of those, the ones that keep their triangles */
    uint64_t n_cell_triangles;      /* on the lists of all those cells */
    uint64_t nbytes;                /* memory held by the volume, */
    uint64_t triangle_cells_nbytes; /* of it, by triangle cells */
    int32_t has_colors;             /* nonzero: samples at the surface carry a colour, */
    int32_t has_normals;            /* a shading normal */
    uint64_t n_objects;             /* of a merged volume, else 0 */
    uint64_t n_shared;              /* samples that hold two objects of it */
    uint64_t n_dropped;             /* thirds that found no place in a sample */
    int32_t surface_lo[3];          /* bounds of the surface cells, inclusive; */
    int32_t surface_hi[3];          /* lo > hi where there are none */
} lr_volume_info;

/* Make an empty volume (all samples 0), fill it by lr_volume_put, then call
 * lr_volume_finish, which classifies the cells; only then may it be used. desc is copied; *volume
 * is the caller's, to be given to lr_volume_free. LR_E_ARGUMENT for a desc out of range, LR_E_SIZE
 * for more samples than a volume holds, LR_E_MEMORY. */
LR_API lr_status lr_volume_begin(const lr_volume_desc *desc, lr_volume **volume, lr_error *error);

/* Write a block of size[0] x size[1] x size[2] samples whose first sample is
 * origin; x varies fastest. samples has desc.sample_type and must be finite;
 * ids (one per sample) may be NULL. touched (one byte per cell, the cell whose
 * lowest corner is the sample) says where a sheet is valid; NULL: everywhere;
 * ignored for solids. Blocks may come in any order and must not overlap. LR_E_ARGUMENT for one
 * beyond the lattice, for a sample that is not finite, and after lr_volume_finish; LR_E_SIZE,
 * LR_E_MEMORY. */
LR_API lr_status lr_volume_put(lr_volume *volume, const int32_t origin[3], const int32_t size[3],
                               const void *samples, const uint16_t *ids, const uint8_t *touched,
                               lr_error *error);

/* Make the volume rectilinear: its planes of samples lie at x[nx], y[ny], z[nz] instead of
 * at 0, 1, 2, ...; finite and increasing. object_from_index is applied to these. The
 * virtual layers around the lattice lie as far off as the outermost two planes are apart
 * (1 where there is one). Not after lr_volume_finish. Gradients and hits are those of the
 * field that is trilinear in each cell. Only traversers that say so take it, and no
 * scene. LR_E_ARGUMENT for planes that do not increase and for a cubic volume, LR_E_MEMORY. */
LR_API lr_status lr_volume_set_planes(lr_volume *volume, const double *x, const double *y,
                                      const double *z, lr_error *error);

/* Classify the cells: LR_E_MEMORY, LR_E_STOPPED; the volume may only be freed then. */
LR_API lr_status lr_volume_finish(lr_volume *volume, const lr_watch *watch, lr_error *error);
LR_API void lr_volume_free(lr_volume *volume); /* NULL is fine */

/* Fill *info, at any time; counts are those of a finished volume. */
LR_API void lr_volume_get_info(const lr_volume *volume, lr_volume_info *info);

/* Read a block back, the inverse of lr_volume_put; it may reach beyond the
 * lattice, where samples are 0. surface[cell] is 1 on surface cells, 2 on those
 * that are exact. The block begins at origin and has size samples along x, y, z; samples, ids and
 * surface, one for each, may be NULL. LR_E_ARGUMENT for a block that lies too far from the lattice.
 */
LR_API lr_status lr_volume_get(const lr_volume *volume, const int32_t origin[3],
                               const int32_t size[3], void *samples, uint16_t *ids,
                               uint8_t *surface, lr_error *error);

/* The first samples of all bricks that are not 0 throughout:
 * origins[n_bricks + n_full][3], the stored ones first, then those whose
 * samples are all 1 and take no memory. A brick can reach beyond the lattice on
 * every side. n is the room in origins: LR_E_SIZE where it does not suffice. */
LR_API lr_status lr_volume_get_bricks(const lr_volume *volume, int32_t *origins, uint64_t n,
                                      lr_error *error);

/* All that a finished volume holds as bytes, for files: lr_volume_pack writes the
 * lr_volume_packed_nbytes of them (0: rectilinear volumes and those of a transfer function have
 * none), lr_volume_unpack makes
 * a volume that is the same to the bit, without textures. Bytes of any origin are safe:
 * LR_E_ARGUMENT or LR_E_SIZE for those that lr_volume_pack of this version cannot have written,
 * and for less room than nbytes should be; LR_E_MEMORY, LR_E_STOPPED. Little-endian. */
LR_API uint64_t lr_volume_packed_nbytes(const lr_volume *volume);
LR_API lr_status lr_volume_pack(const lr_volume *volume, uint8_t *bytes, uint64_t nbytes,
                                const lr_watch *watch, lr_error *error);
LR_API lr_status lr_volume_unpack(const uint8_t *bytes, uint64_t nbytes, const lr_watch *watch,
                                  lr_volume **volume, lr_error *error);

/* Value and gradient of the field at n points in object space:
 * points[n][3], value[n] (0..1), gradient[n][3] (per unit of object space);
 * either output may be NULL. Outside the cells that surface can lie in the field is 0. ids: of a
 * merged volume, whose object's own field; NULL: of the largest samples. gain: 0, or what
 * lr_volume_narrow were to be called with: the field that it would leave. LR_E_ARGUMENT for a
 * volume that is not finished, as of all that follow, and for a gain of a cubic one. */
LR_API lr_status lr_volume_sample(const lr_volume *volume, const double *points,
                                  const uint16_t *ids, uint64_t n, double gain, double *value,
                                  double *gradient, lr_error *error);

/* Make the samples u8, in place, and occupancy gain times as steep at the threshold, as
 * far as 0..1 reaches. No sample changes sides, so that cells stay what they are. Before
 * a structure is built. LR_E_ARGUMENT for a volume that is u8 or cubic and for a gain beyond
 * 0..256; LR_E_MEMORY; after LR_E_STOPPED it may only be freed. */
LR_API lr_status lr_volume_narrow(lr_volume *volume, double gain, const lr_watch *watch,
                                  lr_error *error);

/* Colours and shading normals at n points near the surface, in object space, as hits
 * of the given ids see them (NULL: 0): points[n][3], colors[n][3] (linear RGB),
 * normals[n][3] (unit); NaN where the volume carries none. Either output may be NULL.
 * Textures are averaged over `width` of the surface, in voxels; 0: not at all. LR_E_ARGUMENT for a
 * negative width. */
LR_API lr_status lr_volume_attributes(const lr_volume *volume, const double *points,
                                      const uint16_t *ids, uint64_t n, double width, double *colors,
                                      double *normals, lr_error *error);

/* The shading normals that hits at n points of the surface would have, in object space,
 * outward: points[n][3], ids as above, normals[n][3]; NaN where the field vanishes.
 * normal: lr_normal; LR_E_ARGUMENT for another, and for a rectilinear volume. */
LR_API lr_status lr_volume_normals(const lr_volume *volume, const double *points,
                                   const uint16_t *ids, uint64_t n, int32_t normal, double *normals,
                                   lr_error *error);

/* One volume of n solids, which keep their ids, none in two of them; the number of a
 * part is its object. Their voxels agree, their lattices are a whole number of voxels
 * apart, none has triangle cells. Where objects meet a sample holds two, and each object is
 * hit by its own field; the nearest hit wins, of equal ones that of the lower object. volumes are
 * only read. LR_E_ARGUMENT for volumes that do not go together, LR_E_SIZE, LR_E_MEMORY,
 * LR_E_STOPPED. */
LR_API lr_status lr_volume_merge(const lr_volume *const *volumes, uint64_t n, const lr_watch *watch,
                                 lr_volume **volume, lr_error *error);

/* ---- isosurfaces --------------------------------------------------------- */

/* Types of numbers as files hold them. */
typedef enum lr_number_type {
    LR_NUMBER_U8 = 0,
    LR_NUMBER_I8 = 1,
    LR_NUMBER_U16 = 2,
    LR_NUMBER_I16 = 3,
    LR_NUMBER_U32 = 4,
    LR_NUMBER_I32 = 5,
    LR_NUMBER_F32 = 6,
    LR_NUMBER_F64 = 7
} lr_number_type;

/* Samples that the isosurfaces of any thresholds share; counted, so that the last of these and
 * their maker frees them. */
typedef struct lr_samples lr_samples;

/* A lattice of numbers. A number that is not a number, and one that equals no_data, lies outside
 * whatever the threshold; infinities count as the largest floats. */
typedef struct lr_samples_desc {
    int32_t nx, ny, nz;           /* numbers per axis, at least 1 */
    int32_t number_type;          /* lr_number_type */
    int32_t open;                 /* nonzero: surfaces end at the lattice's border, without caps */
    int32_t has_no_data;          /* nonzero: no_data counts */
    int32_t interpolation;        /* lr_volume_interpolation, of all their isosurfaces */
    int32_t reserved;             /* 0 */
    double no_data;               /* of number_type, or it equals none */
    double object_from_index[16]; /* invertible */
} lr_samples_desc;

/* What lr_samples_scan has found. */
typedef struct lr_samples_range {
    double low, high;    /* least and largest number; low > high: there is none */
    int32_t has_none;    /* nonzero: some numbers lie outside */
    int32_t fits_floats; /* nonzero: a float holds each of the numbers */
} lr_samples_range;

/* How numbers are stored: as gain * number - base, in a type that holds the result, or as floats
 * rounded for one threshold, to the other side of which no number comes by that. */
typedef struct lr_samples_map {
    int32_t sample_type;    /* lr_sample_type */
    int32_t rounded;        /* nonzero: threshold counts */
    double gain, base;      /* gain: a power of two, or minus one */
    double outside, inside; /* numbers: what stands for those that lie outside, which of whole
                               numbers is stored as 0; what bricks hold that take no memory */
    double threshold;       /* a number */
} lr_samples_map;

/* An empty lattice; then lr_samples_scan for every part, or lr_samples_scan_leaves and
 * lr_samples_put_tiles, lr_samples_allocate, and lr_samples_fill or lr_samples_fill_leaves
 * likewise. *samples is the caller's, to be given to lr_samples_free. LR_E_ARGUMENT for a desc
 * out of range, LR_E_SIZE, LR_E_MEMORY. */
LR_API lr_status lr_samples_begin(const lr_samples_desc *desc, lr_samples **samples,
                                  lr_error *error);
LR_API void lr_samples_free(lr_samples *samples); /* NULL is fine */

/* A part of the samples is a layer of bricks: slices *first..*first + *n - 1 of numbers along z.
 * Parts may run side by side; there are *n_parts. LR_E_ARGUMENT for a part that is none. */
LR_API lr_status lr_samples_part(const lr_samples *samples, int32_t part, int32_t *n_parts,
                                 int32_t *first, int32_t *n, lr_error *error);

/* Look at the numbers[n][ny][nx] of a part, x fastest. LR_E_ARGUMENT, LR_E_MEMORY, LR_E_STOPPED. */
LR_API lr_status lr_samples_scan(lr_samples *samples, int32_t part, const void *numbers,
                                 const lr_watch *watch, lr_error *error);

/* Look at n leaves of 8^3 numbers, x fastest, whose first ones lie at origins[n][3]: at -2, 6, 14
 * and so on along each axis, no two at the same place; those that tell others apart may run side by
 * side. LR_E_ARGUMENT for other origins, LR_E_STOPPED. */
LR_API lr_status lr_samples_scan_leaves(lr_samples *samples, const int32_t *origins,
                                        const void *numbers, uint64_t n, const lr_watch *watch,
                                        lr_error *error);

/* Tiles of sizes[n] numbers along each axis, a multiple of 8, that all are values[n]; origins[n][3]
 * as of leaves. They overlap neither each other nor leaves. LR_E_ARGUMENT for others, LR_E_STOPPED.
 */
LR_API lr_status lr_samples_put_tiles(lr_samples *samples, const int32_t *origins,
                                      const int32_t *sizes, const double *values, uint64_t n,
                                      const lr_watch *watch, lr_error *error);

/* Fill *range, of all that was scanned. */
LR_API void lr_samples_get_range(const lr_samples *samples, lr_samples_range *range);

/* Make room for what was scanned, as stored by map; *nbytes: what it takes. Where that is more
 * than max_nbytes (0: no limit), nothing is allocated and LR_E_MEMORY comes. LR_E_ARGUMENT for a
 * map out of range and after it was called, LR_E_SIZE. */
LR_API lr_status lr_samples_allocate(lr_samples *samples, const lr_samples_map *map,
                                     uint64_t max_nbytes, uint64_t *nbytes, lr_error *error);

/* Store the same numbers of a part that were scanned. LR_E_ARGUMENT for a part that is none and
 * before lr_samples_allocate, LR_E_MEMORY, LR_E_STOPPED. */
LR_API lr_status lr_samples_fill(lr_samples *samples, int32_t part, const void *numbers,
                                 const lr_watch *watch, lr_error *error);

/* Store the same n leaves, numbers and origins, that were scanned. LR_E_ARGUMENT as for
 * lr_samples_fill, LR_E_STOPPED. */
LR_API lr_status lr_samples_fill_leaves(lr_samples *samples, const int32_t *origins,
                                        const void *numbers, uint64_t n, const lr_watch *watch,
                                        lr_error *error);

/* The volume whose samples are at or above a stored threshold, outside < threshold <= inside: a
 * solid, or of an open lattice a sheet. lr_isosurface_part is to be called for every part, which
 * may run side by side, then lr_isosurface_finish, which makes the volume one to be used.
 * LR_E_ARGUMENT for a threshold out of range, for samples that are not filled and for a part that
 * is none; LR_E_MEMORY, LR_E_STOPPED. */
LR_API lr_status lr_isosurface_begin(lr_samples *samples, double threshold, lr_volume **volume,
                                     lr_error *error);
LR_API lr_status lr_isosurface_part(lr_volume *volume, int32_t part, const lr_watch *watch,
                                    lr_error *error);
LR_API lr_status lr_isosurface_finish(lr_volume *volume, lr_error *error);

/* ---- visible volumes ----------------------------------------------------- */

/* What values of a field look like. Between knots all is linear in the value, beyond the first and
 * the last it is theirs; two knots at one value are a jump. Extinction, colours, emission and
 * scattering lie between 0 and 1e30. */
typedef struct lr_transfer_desc {
    uint64_t n;               /* knots, 1 to 65536 */
    const double *values;     /* [n], not descending */
    const double *extinction; /* [n], per unit of object space */
    const double *colors;     /* [n][3], linear RGB: radiance that an opaque depth of it has */
    const double *emission;   /* [n][3], linear RGB: radiance per unit of object space, beside what
                                 extinction brings; or NULL: none */
    const double *scattering; /* [n][3], per unit of object space: what of extinction scatters light
                                 instead of absorbing it, 0 where that is 0; or NULL: none */
    double full_gradient; /* 0: all of it is seen everywhere; else times the gradient's length, by
                             central differences at the samples and linear between, as a share of
                             this one, per unit of object space, at most 1 */
} lr_transfer_desc;

typedef struct lr_transfer lr_transfer;

/* The transfer function that desc describes, whose arrays are copied; *transfer is the caller's, to
 * be given to lr_transfer_free. LR_E_ARGUMENT for numbers out of range, LR_E_SIZE for the number of
 * knots, LR_E_MEMORY. */
LR_API lr_status lr_transfer_new(const lr_transfer_desc *desc, lr_transfer **transfer,
                                 lr_error *error);
LR_API void lr_transfer_free(lr_transfer *transfer); /* NULL is fine */

/* By a transfer function the greatest extinction[n] and component of emission[n] of all values in
 * low[n]..high[n]: where both are 0, nothing of these is visible. LR_E_ARGUMENT for a range without
 * values. */
LR_API lr_status lr_transfer_greatest(const lr_transfer *transfer, const double *low,
                                      const double *high, uint64_t n, double *extinction,
                                      double *emission, lr_error *error);

/* Before lr_samples_allocate, of samples with a lattice's border: let bricks take no memory in
 * which nothing is visible, and which no other brick needs. Then lr_visible_begin is for this
 * transfer function alone, with the same scale and offset, bounded and not everywhere.
 * LR_E_ARGUMENT for samples that have room already, a scale or offset out of range; LR_E_MEMORY. */
LR_API lr_status lr_samples_hide(lr_samples *samples, const lr_transfer *transfer, double scale,
                                 double offset, lr_error *error);

/* The volume whose surface cells are the cells of samples in which something is visible by the
 * transfer function of values, of which the volume keeps a copy: a value is offset + scale * stored
 * number. bounded nonzero: samples that equal what is outside are none, and cells that they belong
 * to are never visible, hence none at the lattice's border; else they are values like others, and
 * must not be visible: the volume would fill all of space. everywhere nonzero: all cells are
 * surface cells that hold a value but those of what is outside, visible or not. lr_isosurface_part
 * and lr_isosurface_finish follow as for isosurfaces; between them lr_volume_set_planes may.
 * *volume is for lr_trace by the modes from LR_MODE_VOLUME on. LR_E_ARGUMENT for cubic samples,
 * ones that are not filled, a scale or offset out of range, and a visible outside; LR_E_MEMORY. */
LR_API lr_status lr_visible_begin(lr_samples *samples, const lr_transfer *transfer, double scale,
                                  double offset, int32_t bounded, int32_t everywhere,
                                  lr_volume **volume, lr_error *error);

/* small[nz][ny][nx] is 1 on those samples inside (nonzero in inside[nz][ny][nx]) whose component
 * has fewer than `least` of them, else 0. Samples that share a cell are of one component. LR_E_SIZE
 * for too many, LR_E_ARGUMENT for a lattice without samples, LR_E_MEMORY, LR_E_STOPPED. */
LR_API lr_status lr_small_components(const uint8_t *inside, int32_t nx, int32_t ny, int32_t nz,
                                     uint64_t least, uint8_t *small, const lr_watch *watch,
                                     lr_error *error);

/* ---- programs ----------------------------------------------------------- */

/* Operations of Blender's shader nodes on f32, with Cycles' answers where mathematics
 * has none: a division by 0 gives 0, and so does a power of a negative base whose exponent is
 * no whole number. */
typedef enum lr_operation {
    LR_OP_ADD = 0,
    LR_OP_SUBTRACT = 1,
    LR_OP_MULTIPLY = 2,
    LR_OP_DIVIDE = 3,
    LR_OP_MULTIPLY_ADD = 4, /* a * b + c */
    LR_OP_POWER = 5,
    LR_OP_LOGARITHM = 6, /* of a to the base b */
    LR_OP_SQRT = 7,
    LR_OP_INVERSE_SQRT = 8,
    LR_OP_ABSOLUTE = 9,
    LR_OP_EXPONENT = 10,
    LR_OP_MINIMUM = 11,
    LR_OP_MAXIMUM = 12,
    LR_OP_LESS_THAN = 13, /* 1 or 0, as those that follow */
    LR_OP_GREATER_THAN = 14,
    LR_OP_COMPARE = 15, /* a and b differ by c at most */
    LR_OP_SIGN = 16,
    LR_OP_SMOOTH_MIN = 17, /* within the distance c */
    LR_OP_ROUND = 18,
    LR_OP_FLOOR = 19,
    LR_OP_CEIL = 20,
    LR_OP_TRUNC = 21,
    LR_OP_FRACT = 22,
    LR_OP_MODULO = 23, /* of a's sign */
    LR_OP_FLOORED_MODULO = 24,
    LR_OP_WRAP = 25, /* a into the range from c to b */
    LR_OP_PINGPONG = 26,
    LR_OP_SINE = 27,
    LR_OP_COSINE = 28,
    LR_OP_TANGENT = 29,
    LR_OP_ARCSINE = 30,
    LR_OP_ARCCOSINE = 31,
    LR_OP_ARCTANGENT = 32,
    LR_OP_ARCTAN2 = 33,
    LR_OP_SINH = 34,
    LR_OP_COSH = 35,
    LR_OP_TANH = 36,
    LR_OP_SELECT = 37, /* a is not 0: b, else c */
    LR_OP_FROM_SRGB = 38,
    LR_OP_TABLE = 39 /* a looked up in table b of the program */
} lr_operation;

typedef enum lr_table_kind {
    LR_TABLE_LINEAR = 0,     /* between the values of 0..1, the ends beyond */
    LR_TABLE_CONSTANT = 1,   /* the value before */
    LR_TABLE_EXTRAPOLATE = 2 /* linear, and on in the direction of its ends */
} lr_table_kind;

/* values[first .. first + n - 1] at 0..1 */
typedef struct lr_table {
    uint32_t first, n; /* n is 2 or more */
    int32_t kind;      /* lr_table_kind */
} lr_table;

/* Operands below it are registers, others constants. */
#define LR_PROGRAM_REGISTERS 256

typedef struct lr_instruction {
    uint16_t operation, to; /* lr_operation, a register */
    uint16_t a, b, c;       /* operands; of LR_OP_TABLE b is the number of a table */
} lr_instruction;

/* What shader nodes make of an image's colour. Registers 0..3 hold the colour and its alpha
 * before the first instruction; none of the others is read before it is written. */
typedef struct lr_program {
    const lr_instruction *instructions; /* [n_instructions], run in order */
    uint64_t n_instructions;
    const float *constants; /* [n_constants]: operand LR_PROGRAM_REGISTERS + k is constant k */
    uint64_t n_constants;
    const lr_table *tables; /* [n_tables] */
    uint64_t n_tables;
    const float *values; /* [n_values], of all tables */
    uint64_t n_values;
    uint16_t outputs[3]; /* operands */
    uint16_t reserved;
} lr_program;

/* Of one operation but LR_OP_TABLE; NaN of an unknown one. */
LR_API float lr_operate(int32_t operation, float a, float b, float c);

/* outputs[n][3] of inputs[n][4], colours with alpha. LR_E_ARGUMENT for a program that names what
 * it has not or reads what it has not written, LR_E_SIZE for tables beyond its
 * values. */
LR_API lr_status lr_program_run(const lr_program *program, const float *inputs, uint64_t n,
                                float *outputs, lr_error *error);

/* ---- textures ---------------------------------------------------------- */

typedef enum lr_interpolation {
    LR_INTERPOLATION_LINEAR = 0,
    LR_INTERPOLATION_CLOSEST = 1,
    LR_INTERPOLATION_CUBIC = 2 /* a B-spline, which smooths */
} lr_interpolation;

typedef enum lr_extension { /* what lies outside 0..1 */
                            LR_EXTENSION_REPEAT = 0,
                            LR_EXTENSION_EXTEND = 1, /* the colour of the edge */
                            LR_EXTENSION_CLIP = 2,   /* black */
                            LR_EXTENSION_MIRROR = 3
} lr_extension;

typedef struct lr_texture lr_texture;

/* An image with its smaller versions. pixels[height][width][channels], rows from below, must
 * live longer. Without a program they have 3 channels, of LR_F32 linear RGB, of LR_U8 sRGB,
 * and are interpolated as such. With one they have 3 or 4 (alpha), are interpolated as they
 * are, those of LR_U8 as 0..1, and the program makes linear RGB of what is looked up. A
 * program without pixels makes it of the colours of a mesh's corners, interpolated. Texel
 * (x, y) has its centre at u = (x + 1/2) / width, v = (y + 1/2) / height. */
typedef struct lr_texture_desc {
    const void *pixels;               /* NULL: the corners' colours */
    const lr_program *program;        /* must live longer; or NULL */
    int32_t sample_type, channels;    /* lr_sample_type: LR_U8 or LR_F32; 3, or 4 with a program */
    int32_t width, height;            /* texels */
    int32_t interpolation, extension; /* lr_interpolation, lr_extension */
    int32_t points_only; /* 1: no smaller versions, as it is looked up at points alone */
    int32_t reserved;
} lr_texture_desc;

/* The texture that desc describes, to be given to lr_texture_free. LR_E_ARGUMENT for a desc out of
 * range, LR_E_SIZE for an image with too many texels on a side, LR_E_MEMORY, LR_E_STOPPED. */
LR_API lr_status lr_texture_new(const lr_texture_desc *desc, const lr_watch *watch,
                                lr_texture **texture, lr_error *error);
LR_API void lr_texture_free(lr_texture *texture);             /* NULL is fine */
LR_API uint64_t lr_texture_nbytes(const lr_texture *texture); /* without the pixels */

/* colors[n][3] at uvs[n][2], averaged over footprints[n][3]: the long axis of an ellipse and
 * its width across, in texels (NULL: at points). LR_E_ARGUMENT for a texture of
 * the corners' colours, and for footprints that are not finite or of negative width. */
LR_API lr_status lr_texture_sample(const lr_texture *texture, const float *uvs,
                                   const float *footprints, uint64_t n, float *colors,
                                   lr_error *error);

/* Give an unpacked volume its textures, which its surface is white without; they must
 * live as long, and be as many, in the order in which it was made of them: else LR_E_ARGUMENT. */
LR_API lr_status lr_volume_bind(lr_volume *volume, const lr_texture *const *textures, uint64_t n,
                                lr_error *error);

/* exact[i] is 1 where point i of points[n][3], in object space, lies in a triangle cell.
 * LR_E_ARGUMENT for a volume that is not finished. */
LR_API lr_status lr_volume_exact_at(const lr_volume *volume, const double *points, uint64_t n,
                                    uint8_t *exact, lr_error *error);

/* ---- voxelization ------------------------------------------------------ */

typedef enum lr_color_source {
    LR_COLOR_NONE = -2,  /* white */
    LR_COLOR_VERTEX = -1 /* corner_colors; from 0 on: the texture of that number */
} lr_color_source;

/* What the corners of a mesh's triangles carry into the volume; every array may be
 * NULL. Samples at the surface name their nearest triangles, which the volume keeps: a
 * hit takes what its own one carries. Colours need color_sources; textures must live as
 * long as the volume. */
typedef struct lr_attributes {
    const float *corner_normals;       /* [n_triangles][3][3], outward as the mesh is wound */
    const float *corner_colors;        /* [n_triangles][3][3], linear RGB */
    const float *corner_uvs;           /* [n_triangles][3][2] */
    const int32_t *color_sources;      /* [n_triangles], lr_color_source or number of a texture */
    const lr_texture *const *textures; /* [n_textures] */
    uint64_t n_textures;
} lr_attributes;

typedef struct lr_mesh {
    const double *vertices; /* [n_vertices][3], object space, finite */
    uint64_t n_vertices;
    const int32_t *triangles; /* [n_triangles][3], numbers of vertices, counter-clockwise from
                                 outside */
    uint64_t n_triangles;
    const uint16_t *ids;             /* one per triangle, or NULL */
    const lr_attributes *attributes; /* or NULL */
} lr_mesh;

/* How occupancy falls across the surface: see voxelize/filter_profile.h. */
typedef enum lr_filter {
    LR_FILTER_RAMP = 0,  /* linear in the distance to the surface */
    LR_FILTER_BOX = 1,   /* the exact share of the voxel that is inside */
    LR_FILTER_CONE = 2,  /* the hypercone of Wang and Kaufman: soft */
    LR_FILTER_GAUSS = 3, /* Gaussian: soft */
    LR_FILTER_BINARY = 4 /* inside or outside, nothing between */
} lr_filter;

typedef struct lr_filter_info {
    double half_width; /* voxels, unless asked otherwise; of the Gaussian its sigma */
    double widest;     /* the most that it may be */
    int32_t of_solids; /* nonzero: of solids only */
} lr_filter_info;

/* Write to info what holds for a filter (lr_filter) of samples of that lr_sample_type.
 * LR_E_ARGUMENT for one that is none. */
LR_API lr_status lr_filter_get(int32_t filter, int32_t sample_type, lr_filter_info *info,
                               lr_error *error);

/* How much its occupancy rises per voxel across a plane, at the plane. */
LR_API double lr_filter_slope(int32_t filter, double half_width);

/* Vector instructions; results are the same bits by all of them. */
typedef enum lr_simd {
    LR_SIMD_AUTO = 0, /* the best that processor and system offer */
    LR_SIMD_PORTABLE = 1,
    LR_SIMD_AVX2 = 2,
    LR_SIMD_AVX512 = 3
} lr_simd;

/* Which cells keep the triangles near them, where the field of the samples is not
 * the surface, and are intersected exactly: of sheets at borders, junctions, creases and
 * close pairs, of solids at creases, thin walls and gaps. */
typedef enum lr_exact_cells {
    LR_EXACT_SHEETS = 0, /* those of open surfaces */
    LR_EXACT_ALL = 1,    /* those of solids too: sharper, and larger */
    LR_EXACT_NONE = 2,   /* none: a sheet ends with the cells that it touches */
    LR_EXACT_EVERY = 3   /* all cells that the surface meets: there is no error */
} lr_exact_cells;

typedef struct lr_voxelize_options {
    double voxel_size;   /* edge of a voxel in object space */
    double half_width;   /* of the filter, in voxels; of the Gaussian its sigma */
    int32_t filter;      /* lr_filter */
    int32_t kind;        /* lr_kind */
    int32_t sample_type; /* lr_sample_type */
    int32_t simd;        /* lr_simd; one that is not there is refused */
    int32_t exact;       /* lr_exact_cells */
    int32_t flat;        /* nonzero: the mesh is flat-shaded. Where cells may be exact, they are
                            wherever normals would turn from a facet's by more than 1 degree */
} lr_voxelize_options;

typedef struct lr_voxelizer lr_voxelizer;

typedef enum lr_stage {
    LR_STAGE_NONE = 0,
    LR_STAGE_SET_UP = 1,
    LR_STAGE_COMPONENTS = 2, /* where winding numbers tell inside from outside: which samples go
                            together */
    LR_STAGE_WINDING = 3,    /* and what their winding numbers are */
    LR_STAGE_BRICKS = 4,
    LR_STAGE_CELLS = 5, /* triangle cells, where wanted */
    LR_STAGE_DONE = 6
} lr_stage;

/* Why a mesh is taken for a solid or a sheet. */
typedef enum lr_reason {
    LR_REASON_ASKED = 0,    /* the options say so */
    LR_REASON_CLOSED = 1,   /* solid: every edge has two triangles of one winding */
    LR_REASON_CROSSING = 2, /* solid, closed too, but parts cross or lie in each other */
    LR_REASON_ENCLOSES = 3, /* solid: not closed, but it encloses a volume; holes are small */
    LR_REASON_HOLES = 4,    /* sheet: it has holes that would be seen to be closed */
    LR_REASON_FLIPPED = 5,  /* sheet: neighbouring faces disagree in winding */
    LR_REASON_EMPTY = 6     /* sheet: it encloses nothing */
} lr_reason;

typedef struct lr_voxelizer_info {
    lr_volume_desc desc; /* of the volume to come; its lattice lies on multiples of voxel_size */
    int32_t stage;       /* lr_stage; kind, nbytes and what follows is known after set-up */
    uint64_t nbytes;     /* memory of the finished volume, from above; of triangle cells only what
                            parts have found so far */
    uint64_t n_border_edges; /* edges with one triangle */
    uint64_t n_bad_edges;    /* edges with more than two triangles, or two of opposite winding */
    uint64_t n_degenerate;   /* triangles without area, or on the places of an earlier one */
    int32_t inverted;        /* nonzero: a closed mesh was wound inside out and was turned */
    int32_t simd;            /* lr_simd in use */
    int32_t reason;          /* lr_reason */
    int32_t by_winding;      /* nonzero: winding numbers tell inside from outside */
    double hole;             /* extent of the widest loop of border edges, in voxels */
    uint64_t scratch_nbytes; /* memory beside the volume until lr_voxelizer_free: the most that the
                                stages so far and the present one need, but for threads' own */
} lr_voxelizer_info;

/* Check the mesh, whose arrays must live until lr_voxelizer_free. lr_voxelize_next opens the
 * first stage and says how many parts it has; run every part 0..n_parts-1 once, in any order,
 * side by side if wanted, then open the next stage, until it has none (*n_parts is 0): then
 * lr_voxelize_end makes the volume. options are copied. The voxelizer is to be freed in any case;
 * lr_voxelizer_get_info fills *info at any time. LR_E_ARGUMENT for a mesh or options out of range
 * and for parts out of turn, LR_E_SIZE for voxels so small that they cannot be numbered,
 * LR_E_MEMORY, LR_E_STOPPED. */
LR_API lr_status lr_voxelize_begin(const lr_mesh *mesh, const lr_voxelize_options *options,
                                   const lr_watch *watch, lr_voxelizer **voxelizer,
                                   lr_error *error);
LR_API void lr_voxelizer_get_info(const lr_voxelizer *voxelizer, lr_voxelizer_info *info);
LR_API lr_status lr_voxelize_next(lr_voxelizer *voxelizer, const lr_watch *watch, uint64_t *n_parts,
                                  lr_error *error);
LR_API lr_status lr_voxelize_part(lr_voxelizer *voxelizer, uint64_t part, const lr_watch *watch,
                                  lr_error *error);
LR_API lr_status lr_voxelize_end(lr_voxelizer *voxelizer, const lr_watch *watch, lr_volume **volume,
                                 lr_error *error);
LR_API void lr_voxelizer_free(lr_voxelizer *voxelizer); /* NULL is fine */

/* Tell apart what one field cannot hold: parts of a mesh that cross, touch or
 * meet. layer[n_triangles] is filled with 0..*n_layers-1 so that no two islands
 * of one layer come nearer than margin, judged by their boxes. An island is
 * connected through edges of two triangles of one winding; closed islands and
 * open ones never share a layer, nor do closed ones of opposite winding, but for
 * a cavity with the island around it. Where many islands overlap, the last layer
 * takes the rest. ids of the mesh are not read. LR_E_ARGUMENT for a negative margin or a wrong
 * mesh, LR_E_MEMORY, LR_E_STOPPED. */
LR_API lr_status lr_mesh_layers(const lr_mesh *mesh, double margin, const lr_watch *watch,
                                int32_t *layer, int32_t *n_layers, lr_error *error);

/* Bytes that lr_mesh_layers takes while it runs, its result with them; nothing that is done with
 * a mesh takes less. */
LR_API uint64_t lr_mesh_scratch_nbytes(uint64_t n_vertices, uint64_t n_triangles);

/* Edges at which triangles turn. Half-edge 3 t + e runs from corner e of triangle t to the next;
 * those on the same two vertices are of one edge, with weld nonzero those on the same two places.
 * An edge's first two half-edges are a pair if the cosine between their triangles' normals, of
 * coordinates that are divided by unit in f32, is below the given one; triangles without area
 * never are. pairs[room][2] takes the first `room` of *n_pairs, edge by edge; *n_border is the
 * number of edges with one half-edge. Half-edges without length are of no edge. ids and
 * attributes of the mesh are not read. LR_E_ARGUMENT for a unit of 0 or a wrong mesh, LR_E_MEMORY,
 * LR_E_STOPPED. */
LR_API lr_status lr_mesh_edges(const lr_mesh *mesh, int32_t weld, double unit, double cosine,
                               uint32_t *pairs, uint64_t room, const lr_watch *watch,
                               uint64_t *n_pairs, uint64_t *n_border, lr_error *error);

/* ---- distance ---------------------------------------------------------- */

typedef enum lr_metric {
    LR_METRIC_CHESSBOARD = 0, /* the largest of the three differences */
    LR_METRIC_CITYBLOCK = 1,  /* their sum */
    LR_METRIC_CHAMFER345 = 2, /* steps to a neighbour by face, edge, corner cost 3, 4, 5 */
    LR_METRIC_EUCLID = 3
} lr_metric;

#define LR_EUCLID_MAX 26754 /* 3 (LR_EUCLID_MAX - 1)^2 fits int32_t */

/* dist[nz][ny][nx]: distance from every cell to the nearest one that is nonzero in
 * cells[nz][ny][nx]; 0 on those. By chessboard and city-block uint8_t, in cells; by
 * chamfer uint8_t, in thirds of a cell; these are capped at 255. By Euclid float, in
 * cells, infinity where no cell is nonzero; sides of at most LR_EUCLID_MAX cells, else
 * LR_E_SIZE. LR_E_ARGUMENT for an unknown metric or no cells, LR_E_STOPPED. */
LR_API lr_status lr_distance(const uint8_t *cells, int32_t nx, int32_t ny, int32_t nz,
                             int32_t metric, void *dist, const lr_watch *watch, lr_error *error);

/* The same in steps 0..*n_steps-1, one after the other, each of parts 0..*n_parts-1 that
 * may run side by side: all of them together fill dist from cells, with the same bits. As
 * lr_distance; LR_E_ARGUMENT also for a step or part that there is not. */
LR_API lr_status lr_distance_parts(int32_t nx, int32_t ny, int32_t nz, int32_t metric, int32_t step,
                                   int32_t *n_steps, int64_t *n_parts, lr_error *error);
LR_API lr_status lr_distance_part(const uint8_t *cells, int32_t nx, int32_t ny, int32_t nz,
                                  int32_t metric, int32_t step, int64_t part, void *dist,
                                  const lr_watch *watch, lr_error *error);

/* ---- traversers and structures ----------------------------------------- */

typedef enum lr_traverser_flag {
    LR_TRAVERSER_EXACT = 1,       /* agrees with the integer oracle but for ties */
    LR_TRAVERSER_DEFAULT = 2,     /* set for one of them */
    LR_TRAVERSER_RECTILINEAR = 4, /* takes rectilinear volumes */
    LR_TRAVERSER_TRIAL = 8        /* builds little: worth a trial where the fastest is wanted */
} lr_traverser_flag;

typedef struct lr_traverser {
    const char *name;    /* as in options and files */
    const char *label;   /* as in menus */
    const char *source;  /* who published it */
    const char *about;   /* one sentence: how it works, or what it may miss; where that depends on
                             an option, "{name:first|second|..}" holds the words of each choice */
    const char *options; /* "name=first|second|third! name=...": its options and their choices; the
                            first is the default, one marked ! gives exactness up */
    uint32_t flags;      /* lr_traverser_flag */
} lr_traverser;

/* How many there are, and what is said of each, 0..lr_traverser_count()-1: *traverser is filled
 * with texts that live as long as the library. LR_E_ARGUMENT for another index. */
LR_API int32_t lr_traverser_count(void);
LR_API lr_status lr_traverser_get(int32_t index, lr_traverser *traverser, lr_error *error);

typedef struct lr_structure lr_structure;

/* What the traverser needs beside the volume, which must live longer. choices:
 * for each of its options the number of the choice; NULL: 0 for all. *structure is to be given to
 * lr_structure_free. LR_E_ARGUMENT for an unknown traverser or choice, and for a volume that is not
 * finished or that it does not take; LR_E_SIZE, LR_E_MEMORY, LR_E_STOPPED. */
LR_API lr_status lr_structure_build(const lr_volume *volume, int32_t traverser,
                                    const int32_t *choices, const lr_watch *watch,
                                    lr_structure **structure, lr_error *error);
LR_API void lr_structure_free(lr_structure *structure);             /* NULL is fine */
LR_API uint64_t lr_structure_nbytes(const lr_structure *structure); /* without the volume */
/* 1: rays of scenes meet the volume's triangles by a tree, whatever the traverser; else 0. */
LR_API int32_t lr_structure_has_tree(const lr_structure *structure);
/* The box in which scenes look for what rays can hit, in lattice coordinates; lo > hi: there is
 * nothing. */
LR_API void lr_structure_bounds(const lr_structure *structure, double lo[3], double hi[3]);

/* ---- tracing ----------------------------------------------------------- */

typedef enum lr_mode {
    LR_MODE_SURFACE = 0, /* the first crossing of f = T, in either direction */
    LR_MODE_BINARY = 1,  /* the first object cell: largest of its samples >= T */
    LR_MODE_VOLUME = 2,  /* emission and absorption along the whole ray */
    LR_MODE_MAXIMUM = 3, /* the largest value along it */
    LR_MODE_MINIMUM = 4, /* the smallest */
    LR_MODE_MEAN = 5     /* the mean of all values along it */
} lr_mode;

/* How LR_MODE_VOLUME adds up what lies along a ray. Samples lie at t = k * step for whole k; each
 * stands for a step of its extinction, and what lies between two of them is lost. */
typedef enum lr_sampling {
    LR_SAMPLING_EXACT = 0, /* integrals of the field's cubic in each cell, without steps */
    LR_SAMPLING_POST = 1, /* samples of the field, classified: misses what is thinner than a step */
    LR_SAMPLING_PRE = 2   /* samples of classified corners: misses values between these, too, and
                             blurs */
} lr_sampling;

/* How a cell is asked whether f = T lies in it. The uniform test is not for sheets and cubic
 * volumes, and takes the roots bisect and linear only. Of cubic volumes the test by extrema is one
 * by Bernstein polynomials, as sure; it loses no surface that the field passes by more than 2^-46
 * of what samples differ by from T. */
typedef enum lr_hit_test {
    LR_HIT_EXTREMA = 1, /* also look at the field's extrema inside a cell, so that no surface is
                           lost */
    LR_HIT_FACES = 0,   /* look at the field on the faces of cells only: fast, but loses grazing
                           surfaces */
    LR_HIT_UNIFORM = 2  /* look at the field at equal steps along the ray: loses what lies between
                           them */
} lr_hit_test;

/* Cubic volumes do not take LR_ROOT_CUBIC: along a ray their field is of degree 9. */
typedef enum lr_root {
    LR_ROOT_NEWTON = 0, /* Newton's steps inside a bracket, to full precision */
    LR_ROOT_BISECT = 2, /* halving of a bracket, to full precision: slower */
    LR_ROOT_CUBIC = 3,  /* the roots of the cubic in closed form, to full precision */
    LR_ROOT_LINEAR = 1  /* one linear interpolation: fast and approximate */
} lr_root;

/* Of cubic volumes the first three are all the gradient of the field, which is smooth. */
typedef enum lr_normal {
    LR_NORMAL_CENTRAL = 0,  /* central differences, interpolated: smooth */
    LR_NORMAL_ANALYTIC = 1, /* the gradient of the field itself: faceted at cell borders */
    LR_NORMAL_SMOOTH = 2, /* the gradients of the eight cells around, blended: smooth, and slower */
    LR_NORMAL_SOBEL = 3,  /* central differences averaged over nine: for noise, and slower */
    LR_NORMAL_ZUCKER_HUMMEL = 4 /* as sobel, by the distance: turns least with the lattice */
} lr_normal;

/* How samples are lit: by a light far away that nothing shadows, by the gradient as a normal, which
 * faces the viewer; colours are times ambient + diffuse n.l, and specular (r.v)^power is added, r
 * the reflection of l by n. Without a gradient the ambient share is all. */
typedef struct lr_phong {
    double ambient, diffuse, specular; /* 0 to 1e6 */
    double light[3]; /* towards the light, in object space, of any length; 0, 0, 0:
                        at the viewer, back along each ray */
    int32_t power;   /* 1 to 1024 */
    int32_t reserved;
} lr_phong;

typedef struct lr_trace_options {
    int32_t mode;     /* lr_mode */
    int32_t hit_test; /* lr_hit_test */
    int32_t root;     /* lr_root */
    int32_t normal;   /* lr_normal */
    double step;      /* of the uniform hit test and of sampling, in voxels, above 0 */
    int32_t sampling; /* lr_sampling, of LR_MODE_VOLUME, as what follows: */
    int32_t reserved;
    double tolerance; /* what exact integrals may be off: that share of the largest colour, and of
                         the emission along the ray; 1e-9 to 1 */
    double stop_opacity;   /* rays end where they are as opaque: above 0, at most 1, never but where
                              what remains is below 1e-16 */
    const lr_phong *phong; /* of sampling post, by the normals central and analytic; NULL: colours
                              are as they are */
} lr_trace_options;

/* Where a secondary ray leaves a surface: the search in this cell takes the
 * ray's start as lying on the given side, whatever rounding makes of it. */
typedef struct lr_start {
    int32_t cell[3];
    int32_t side; /* -1: where f < T; +1: where f >= T; 0: unknown, cell is not read */
} lr_start;

/* n rays P = o + t d in object space, o = (ox, oy, oz), d = (dx, dy, dz), an array each; d need
 * not be unit. A ray with a zero
 * or non-finite component where none is allowed (d = 0, NaN, infinity) misses. */
typedef struct lr_rays {
    const double *ox, *oy, *oz;
    const double *dx, *dy, *dz;
    const double *t_min;    /* NULL: 0; not below 0 where start is used */
    const double *t_max;    /* NULL: infinity */
    const lr_start *start;  /* NULL: unknown */
    const double (*way)[3]; /* [n]: by which a start gets clear of the triangles that it lies on, in
                               voxels, where the caller has it from the hit; NaN, or NULL: found */
    const double *length;   /* of the direction, as extinction and emission count; NULL: as it is in
                               object space */
    const double *stop; /* of LR_MODE_VOLUME, exact sampling: the transmittance at which each ray
                           ends; NULL: see stop_opacity */
} lr_rays;

/* One entry per ray; any pointer but t may be NULL. */
typedef struct lr_hits {
    double *t;             /* infinity on a miss; with lr_rays.stop: where the ray ends, infinity
                              where it does not */
    int32_t *ci, *cj, *ck; /* the cell hit */
    double *nx, *ny, *nz;  /* unit normal in object space, towards f < T; the mesh's own smooth
                              one where the volume carries it, but for LR_NORMAL_ANALYTIC */
    double *gx, *gy, *gz;  /* unit normal of the field itself: tells the
                              side on which a secondary ray starts */
    int32_t *id;           /* of the object sample nearest the hit; 0 without ids */
    uint32_t *triangle; /* of those that triangle cells keep; UINT32_MAX where the field was hit */
    int32_t *steps;     /* cells in which the ray stood */
    double *red, *green, *blue; /* of LR_MODE_VOLUME: radiance along the ray, linear RGB, without
                                   what lies behind it, of which comes; with lr_rays.stop instead
                                   the share of light that is scattered where the ray ends */
    double *transmittance;      /* that share, 0..1 */
    double *value;  /* of LR_MODE_MAXIMUM, _MINIMUM and _MEAN, as the transfer function has values;
                       NaN on a miss */
    double *length; /* of LR_MODE_MEAN: of the ray's path through visible cells, in object space */
} lr_hits;

typedef struct lr_counters {
    uint64_t rays;       /* that were traced */
    uint64_t cells;      /* cells in which a ray stood */
    uint64_t jumps;      /* steps over more than one cell */
    uint64_t nodes;      /* nodes of a tree that were looked at on the way down, up and past them */
    uint64_t tests;      /* cells in which the surface was searched */
    uint64_t samples;    /* evaluations of f */
    uint64_t hits;       /* rays that hit */
    uint64_t most_cells; /* in which a single ray stood: the largest, not a sum */
    uint64_t forgotten;  /* times that a ray was in more solids than it can keep in mind */
    uint64_t pairs;      /* of a ray and a volume in which it was traced */
    uint64_t in_lanes;   /* of these: beside other rays, or by several triangles side by side */
} lr_counters;

/* Trace n rays into the arrays of hits. counters is added to; NULL costs nothing. Of the modes from
 * LR_MODE_VOLUME on, t is where the ray begins to see something, of LR_MODE_MAXIMUM and _MINIMUM
 * where the value is; only values in visible cells count; starts are not read, and normals, ids and
 * triangles are those of a miss. LR_E_ARGUMENT for options out of range or that the volume does not
 * take, LR_E_STOPPED. */
LR_API lr_status lr_trace(const lr_structure *structure, const lr_rays *rays, uint64_t n,
                          const lr_trace_options *options, const lr_hits *hits,
                          lr_counters *counters, const lr_watch *watch, lr_error *error);

/* ---- rendering --------------------------------------------------------- */

/* A ray through film point (x, y), in pixels from the image's lower left
 * corner: with F = corner + x * dx + y * dy, a perspective ray is eye + t F, an
 * orthographic one eye + F + t forward. F and forward are scaled so that t is
 * the depth along the camera's axis. All in world space. */
typedef enum lr_projection { LR_PERSPECTIVE = 0, LR_ORTHOGRAPHIC = 1 } lr_projection;

typedef struct lr_camera {
    int32_t projection; /* lr_projection */
    int32_t reserved;
    double eye[3], forward[3];      /* as said above, as are those of */
    double corner[3], dx[3], dy[3]; /* the film */
    double clip_start, clip_end;    /* depth */
} lr_camera;

/* Rays that see a thing: flags of instances, lights and the world. */
typedef enum lr_visibility {
    LR_VISIBLE_CAMERA = 1,
    LR_VISIBLE_SHADOW = 2, /* instances: stop light; lights: are stopped by instances */
    LR_VISIBLE_DIFFUSE = 4,
    LR_VISIBLE_GLOSSY = 8,
    LR_VISIBLE_TRANSMISSION = 16,
    LR_VISIBLE_VOLUME_SCATTER = 32
} lr_visibility;

#define LR_BOUNCES_MAX 1024 /* of any limit of bounces in lr_tile: they are counted in 16 bits */

typedef enum lr_light_kind {
    LR_LIGHT_SUN = 0,
    LR_LIGHT_POINT = 1,
    LR_LIGHT_SPOT = 2, /* a point light behind a hole, within a cone */
    LR_LIGHT_AREA = 3  /* shines to one side */
} lr_light_kind;

typedef enum lr_light_shape {
    LR_LIGHT_ROUND = 0, /* area: an ellipse; point and spot: a disc that faces what it lights */
    LR_LIGHT_FULL = 1   /* area: a parallelogram; point and spot: a sphere */
} lr_light_shape;

/* All in world space. color: of a sun the irradiance on a plane that faces it; of
 * a point light the radiant intensity, of a spot light that on its axis (irradiance
 * is color / distance^2); of an area light the radiance that it would send with the
 * widest spread; a negative one takes light away. Neither radius nor angle of a sun change
 * what arrives in all. */
typedef struct lr_light {
    int32_t kind;        /* lr_light_kind */
    int32_t shape;       /* lr_light_shape */
    uint32_t visibility; /* lr_visibility */
    int32_t max_bounces; /* surfaces behind more bounces than these do not ask it */
    double position[3];  /* centre of all but suns */
    double direction[3]; /* unit: towards a sun; the way that spot and area lights shine */
    double axis_u[3];    /* of an area light: its sides, or the diameters of the ellipse, */
    double axis_v[3];    /* at right angles to direction and to each other, unless it is sheared */
    double color[3];
    double radius; /* of point and spot lights, 0 or more */
    double angle;  /* full, 0..pi: of a sun's disc, of a spot's cone, and the spread of an area;
                      a spread of 0 is a beam */
    double blend;  /* 0..1: share of the cone in which a spot light fades */
    double
        plane_margin; /* of an area light that lies in a surface: so far behind its plane, or before
                         it where negative, rays to it end, and nearer points before it get none */
} lr_light;

/* What one part of a surface does to light. */
typedef enum lr_lobe_kind {
    LR_LOBE_DIFFUSE = 0,     /* Lambert's law */
    LR_LOBE_GLOSSY = 1,      /* GGX microfacets that reflect color */
    LR_LOBE_GLASS = 2,       /* GGX microfacets of a dielectric: reflect and refract, times color */
    LR_LOBE_REFRACTION = 3,  /* refract all but what is reflected totally, which is lost */
    LR_LOBE_TRANSPARENT = 4, /* color goes straight through */
    LR_LOBE_EMISSION = 5,    /* shines with the radiance color */
    LR_LOBE_PRINCIPLED = 6   /* Blender's Principled BSDF, without sheen, coat, subsurface, film */
} lr_lobe_kind;

typedef enum lr_lobe_flag {
    LR_LOBE_TEXTURED = 1,    /* the volume's colours multiply color */
    LR_LOBE_MULTISCATTER = 2 /* light between microfacets is not lost */
} lr_lobe_flag;

typedef struct lr_lobe {
    int32_t kind;     /* lr_lobe_kind */
    uint32_t flags;   /* lr_lobe_flag */
    double weight;    /* share in a mix, 0 or more */
    double color[3];  /* linear RGB: what is reflected or let through; of emission radiance */
    double roughness; /* 0..1, as perceived: GGX's alpha is its square */
    double ior;       /* index of refraction, above 0 */
    /* of principled lobes only; color is their base colour */
    double metallic;         /* 0..1 */
    double specular;         /* 0..1: level of the reflection; 0.5 is what ior says */
    double specular_tint[3]; /* color of the reflection seen straight on */
    double transmission;     /* 0..1 */
    double alpha;            /* 0..1 */
    double emission[3];      /* radiance */
} lr_lobe;

#define LR_LOBES_MAX 8

/* Into which directions volumes scatter. */
typedef enum lr_phase_kind {
    LR_PHASE_HENYEY_GREENSTEIN = 0,
    LR_PHASE_RAYLEIGH = 1 /* of particles much smaller than the light's wavelength */
} lr_phase_kind;

typedef struct lr_material_desc {
    const lr_lobe *lobes; /* [n_lobes], summed up */
    uint32_t n_lobes;     /* at most LR_LOBES_MAX; none: black */
    int32_t index;        /* the value of the material index pass */
    double absorption[3]; /* inside solids, per unit of world length (Beer's law), */
    double scattering[3]; /* likewise: light that is turned into other directions, */
    double glow[3];       /* and radiance that is added, which may be negative */
    double anisotropy;    /* of what is scattered: as of lr_instance */
    int32_t phase;        /* lr_phase_kind */
    int32_t bare;         /* nonzero: no surface, and no lobes: rays meet what is inside alone */
} lr_material_desc;

/* What surrounds the scene. */
typedef struct lr_world {
    double color[3]; /* radiance, which may be negative; multiplies the image */
    double
        image_from_world[9]; /* rotation that takes directions to those of the image, row-major */
    const lr_texture *image; /* of radiance by longitude and latitude, must live longer; or NULL */
    uint32_t visibility;     /* lr_visibility; shadow is not read */
    int32_t max_bounces;     /* as of lr_light; of a world with an image */
} lr_world;

/* A solid that cuts an instance: hits of the instance on one side of it count, the others are
 * passed through. The faces of the cut are an instance of the solid's own structure, of which the
 * hits inside the volume that is cut count. */
typedef struct lr_clip {
    const lr_volume *volume;      /* must live longer */
    double world_from_object[16]; /* invertible */
    double margin;  /* in occupancy, 0 or more: hits that lie so little on the wrong side count */
    int32_t inside; /* nonzero: hits inside the solid count; else those outside */
    int32_t reserved;
} lr_clip;

/* What of a field hits take: the length of the gradient is per unit of world length. */
typedef enum lr_field_part {
    LR_FIELD_VALUE = 0,
    LR_FIELD_SLOPE = 1,
    LR_FIELD_ID = 2 /* no colour: the id, and so the material, that weighs most among the
                        samples inside, averaged by 1-2-1 along each axis */
} lr_field_part;

/* A scalar field that colours the hits of an instance: the program makes linear RGB of the grey
 * of its value = offset + scale * occupancy, or of its slope. Beyond the lattice occupancy and
 * slope are 0. */
typedef struct lr_field_color {
    const lr_volume *volume;      /* must live longer, as must the program */
    double world_from_object[16]; /* invertible */
    const lr_program *program;    /* of LR_FIELD_ID: NULL */
    double scale, offset;
    int32_t part; /* lr_field_part */
    int32_t reserved;
} lr_field_color;

typedef struct lr_instance {
    const lr_structure *structure; /* not of a rectilinear volume */
    double world_from_object[16];  /* invertible */
    uint32_t visibility;           /* lr_visibility */
    int32_t object_index;          /* the value of the object index pass */
    uint32_t first_material;       /* id m of a hit has material slots[first_material + min(m,
                                      n_materials-1)] */
    uint32_t n_materials;          /* at least 1 */
    int32_t volume_index;          /* the value of the volume pass */
    int32_t holdout;               /* the camera sees a hole in the picture: alpha 0, no light */
    double error;                  /* of its surface, in world space, for the error pass */
    const lr_clip *clips;          /* [n_clips]; light is not bent or absorbed inside what is cut */
    uint64_t n_clips;
    const lr_field_color *field_color; /* in place of the colours that the volume keeps; or NULL */
    double volume_unit; /* of a volume with a transfer function: the length in world space that its
                           extinction, emission and scattering are for; 0: the unit of object
                           space */
    double
        anisotropy; /* of what it scatters: mean cosine, -1 to 1, of LR_PHASE_HENYEY_GREENSTEIN */
    double gradient_shading; /* 0..1: of what it scatters, how much reflects like a surface whose
                                normal is the gradient: times 1 - exp(-gradient_scale * slope), */
    double gradient_scale;   /* of the gradient's length slope in values per unit of object space; 0
                                or more; */
    double roughness;        /* and of that surface, 0..1, as of lr_lobe, */
    double specular;         /* likewise, with an index of refraction of 1.5 */
    int32_t phase;           /* lr_phase_kind */
    int32_t reserved;
} lr_instance;

#define LR_OWN_INDEX -2147483647

typedef struct lr_scene_desc {
    lr_camera camera;             /* its pixels are those of the tiles */
    const lr_instance *instances; /* [n_instances] */
    uint64_t n_instances;
    const lr_light *lights; /* [n_lights] */
    uint64_t n_lights;
    const lr_material_desc *materials; /* [n_materials] */
    uint64_t n_materials;
    const uint32_t *slots;       /* [n_slots], indices into materials */
    const int32_t *slot_objects; /* [n_slots] object index of hits with that slot; NULL, or
                                    LR_OWN_INDEX for one slot: their instance's */
    uint64_t n_slots;
    lr_world world;                /* what surrounds it */
    double mist_start, mist_depth; /* of the mist pass: distances from the camera */
    double mist_power;             /* of the way into the mist: 1, 2 or 1/2 in Blender */
    int32_t film_transparent;      /* nonzero: the camera sees alpha in place of the world */
    int32_t lone_media; /* nonzero: a surface bends light by its own index alone, as if it lay
                           in a void; else by its ratio to that of the solid around */
} lr_scene_desc;

typedef struct lr_scene lr_scene;

/* Copies everything of desc but the structures and the world's image, which must live longer, and
 * builds the hierarchy over the instances. *scene is to be given to lr_scene_free. LR_E_ARGUMENT
 * for what is out of range, with a sentence that names it; LR_E_SIZE, LR_E_MEMORY. */
LR_API lr_status lr_scene_new(const lr_scene_desc *desc, lr_scene **scene, lr_error *error);
LR_API void lr_scene_free(lr_scene *scene); /* NULL is fine */

typedef enum lr_film_filter {
    LR_FILM_BOX = 0,            /* the mean over the pixel itself: sharp edges */
    LR_FILM_BLACKMAN_HARRIS = 1 /* Cycles' own: smooth edges, no stair steps */
} lr_film_filter;

/* By what a ray was sent on last. */
typedef enum lr_ray_kind {
    LR_RAY_CAMERA = 0, /* by none */
    LR_RAY_DIFFUSE = 1,
    LR_RAY_GLOSSY = 2,
    LR_RAY_TRANSMISSION = 3,
    LR_RAY_TRANSPARENT = 4, /* straight through */
    LR_RAY_VOLUME = 5       /* scattered within a volume */
} lr_ray_kind;

/* Events come in the order in which they happen; contributions are added to the pixel in the
 * order of the events that hold them. */
typedef enum lr_event_kind {
    LR_EVENT_RAY = 0,    /* a path starts its next ray */
    LR_EVENT_HIT = 1,    /* that ray has ended, at a surface or nowhere */
    LR_EVENT_LIGHT = 2,  /* a surface samples a light */
    LR_EVENT_FOUND = 3,  /* a ray meets a light, the world, or a surface that shines */
    LR_EVENT_SCATTER = 4 /* a volume scatters light before that end */
} lr_event_kind;

/* One thing that happens on a path. Members without a kind are of all; what is not of an
 * event's kind is 0. All in world space. */
typedef struct lr_event {
    int32_t kind;        /* lr_event_kind */
    uint32_t sample;     /* of the pixel, from 0 */
    uint32_t ray;        /* a number that no other ray of the sample has, nor a SCATTER of it */
    uint32_t parent;     /* RAY: of what it comes from; its own for the camera's; SCATTER: of the
                            ray */
    int32_t ray_kind;    /* RAY: lr_ray_kind */
    int32_t bounces;     /* of the path behind the ray, without transparent surfaces */
    int32_t transparent; /* such surfaces behind it */
    int32_t last;        /* RAY: nonzero: beyond a limit of bounces, it is scattered no more */
    uint32_t instance; /* RAY: whose surface it leaves; HIT: hit; SCATTER: whose volume; LIGHT: that
                          stops the light; UINT32_MAX: none */
    uint32_t material; /* HIT: index into the scene's materials */
    int32_t id;        /* HIT, as in lr_hits */
    uint32_t triangle; /* HIT, as in lr_hits: UINT32_MAX where the field was hit */
    int32_t cell[3];   /* RAY: that it starts in; HIT: of the hit */
    int32_t side;      /* RAY, as in lr_start; HIT: of the viewer: 1 inside, -1 outside */
    int32_t steps;     /* HIT: cells in which the ray stood */
    uint32_t n_media;  /* RAY: solids that bend or absorb light and that it is in, */
    uint32_t media[6]; /* the instance of each, the one entered last at the end */
    uint32_t media_material[6]; /* and its material */
    uint64_t light;         /* LIGHT, FOUND: its index, n_lights for the world, UINT64_MAX for the
                               surface itself, UINT64_MAX - 1 for volumes before it */
    double origin[3];       /* RAY; LIGHT: where its ray to the light starts */
    double direction[3];    /* RAY: t as in lr_camera for the camera's, else unit; LIGHT: unit */
    double t;               /* RAY: where it ends at the latest; HIT, infinity on a miss; SCATTER;
                               LIGHT: the distance of the light */
    double throughput[3];   /* RAY: at its start; HIT: at its end; SCATTER: of what is scattered */
    double position[3];     /* HIT, SCATTER */
    double normal[3];       /* HIT: unit, for shading, on the viewer's side */
    double probability;     /* LIGHT: expected samples of this light by this surface */
    double pdf;             /* LIGHT: per solid angle; 1 for a light without extent */
    double weight;          /* LIGHT, FOUND: by multiple importance sampling, 0..1 */
    double contribution[3]; /* LIGHT, FOUND: added to the pixel's sum over samples */
} lr_event;

/* What happens in a pixel, in the caller's array. */
typedef struct lr_record {
    lr_event *events;  /* [capacity] */
    uint64_t capacity; /* events beyond it are counted, but not written */
    uint64_t n;        /* events so far; added to, as is the next */
    uint64_t samples;  /* of the pixel */
} lr_record;

#define LR_BRANCHES_MAX 16

/* Limits of bounces count as in Cycles: a ray beyond its limit still finds lights,
 * the world and shining surfaces, but is not scattered again. */
typedef struct lr_tile {
    int32_t x, y, width, height; /* pixels of the image; row 0 is the lowest */
    int32_t samples;             /* per pixel; the most, where there is a threshold */
    int32_t min_samples;         /* before a pixel may be settled; 0: by the threshold */
    double noise_threshold;      /* below which a pixel is settled, as in Cycles; 0: never */
    int32_t filter;              /* lr_film_filter */
    uint32_t seed;               /* of the random numbers */
    double filter_width;         /* pixels; Blackman and Harris's reaches so far to either side */
    int32_t max_bounces;         /* in all, without transparent_bounces */
    int32_t diffuse_bounces, glossy_bounces, transmission_bounces, transparent_bounces,
        volume_bounces;      /* by kind */
    int32_t branches;        /* rays of one sample that may be on their way at a time, up to
                                LR_BRANCHES_MAX:
                                where a surface sends off more, some are left to chance */
    double ao_distance;      /* reach of the ambient occlusion pass in world space */
    double ambient_distance; /* what lies farther keeps no light of the world from a surface whose
                                diffuse rays are scattered no more: cheap and bright; 0: all does */
    double clamp_direct, clamp_indirect; /* most that one ray may bring, mean of its channels,
                                    straight and after bounces, as in Cycles; 0: any */
    lr_trace_options trace;              /* mode must be LR_MODE_SURFACE */
    lr_record *record;                   /* of a tile of one pixel; or NULL, which costs nothing */
} lr_tile;

/* Buffers of the tile alone, rows from below; any but combined may be NULL. The
 * geometry passes come from the pixel's centre. */
typedef struct lr_passes {
    float *combined;       /* [height][width][4], premultiplied by alpha */
    float *depth;          /* [height][width], along the camera's axis; 1e10 where nothing is */
    float *normal;         /* [height][width][3], world space, towards the camera's side */
    float *position;       /* [height][width][3], world space */
    float *object_index;   /* [height][width], as all that follow unless said */
    float *material_index; /* lr_material_desc.index */
    float *mist;           /* 0..1, 1 where nothing is */
    float *ao;             /* share of the sky that is seen within ao_distance */
    float *emission;       /* [height][width][3] */
    float *environment;    /* [height][width][3] */
    float *error;          /* lr_instance.error in widths of a pixel there */
    float *volume;         /* lr_instance.volume_index */
    float *steps;          /* cells in which the ray through the pixel's centre stood */
} lr_passes;

/* Render the tile into passes. workspace: nbytes of the caller's memory, of one call at a time;
 * lr_render_nbytes tells how many a tile of that size and so many branches wants, whatever the
 * limits of bounces (0: out of range). The scene is only read; counters is added to. LR_E_ARGUMENT
 * for a tile out of range, LR_E_SIZE for too small a workspace, LR_E_STOPPED: the passes are
 * undefined then. */
LR_API uint64_t lr_render_nbytes(const lr_scene *scene, int32_t width, int32_t height,
                                 int32_t branches);
LR_API lr_status lr_render_tile(const lr_scene *scene, const lr_tile *tile, const lr_passes *passes,
                                void *workspace, uint64_t nbytes, lr_counters *counters,
                                const lr_watch *watch, lr_error *error);

/* ---- whole images ------------------------------------------------------ */

typedef enum lr_image_flag {
    LR_IMAGE_EXACT = 1, /* cells and t are those of lr_trace in LR_MODE_BINARY, cell by cell */
    LR_IMAGE_PERSPECTIVE = 2, /* takes perspective cameras, too; all take orthographic ones */
    LR_IMAGE_SURFACES = 4,    /* shows the first object cells */
    LR_IMAGE_LIGHTS = 8,      /* shades by lights (lr_prepared_light) and gives normals; others
                                 shade by depth */
    LR_IMAGE_FRAMES = 16      /* takes the frame before, and is faster with it */
} lr_image_flag;

typedef struct lr_image_method {
    const char *name;    /* as in options and files */
    const char *label;   /* as in menus */
    const char *source;  /* who published it */
    const char *about;   /* one sentence, as that of lr_traverser */
    const char *options; /* as those of lr_traverser */
    uint32_t flags;      /* lr_image_flag */
} lr_image_method;

/* How many there are, and what is said of each, 0..lr_image_method_count()-1: *method is filled
 * with texts that live as long as the library. LR_E_ARGUMENT for another index. */
LR_API int32_t lr_image_method_count(void);
LR_API lr_status lr_image_method_get(int32_t index, lr_image_method *method, lr_error *error);

/* What a method needs beside the volume, which must live longer. */
typedef struct lr_prepared lr_prepared;

/* method: its index; choices: as of lr_structure_build. *prepared is to be given to
 * lr_prepared_free. LR_E_ARGUMENT for an unknown method or choice, and for a volume that is not
 * finished, rectilinear or cubic; LR_E_SIZE, LR_E_MEMORY, LR_E_STOPPED. */
LR_API lr_status lr_prepare(const lr_volume *volume, int32_t method, const int32_t *choices,
                            const lr_watch *watch, lr_prepared **prepared, lr_error *error);
LR_API void lr_prepared_free(lr_prepared *prepared);             /* NULL is fine */
LR_API uint64_t lr_prepared_nbytes(const lr_prepared *prepared); /* without the volume */

#define LR_IMAGE_LIGHTS_MAX 32

/* A light as methods with LR_IMAGE_LIGHTS take it, in object space. */
typedef struct lr_image_light {
    double place[3]; /* of a point; of a distant light the unit direction towards it */
    double color[3]; /* as that of lr_light: radiant intensity; of a distant light irradiance */
    int32_t distant; /* nonzero: it has a direction and no place */
    int32_t reserved;
} lr_image_light;

/* Set light `index`, 0..LR_IMAGE_LIGHTS_MAX-1, or take it away where light is NULL. What the volume
 * keeps of other lights is left alone; nothing of prepared changes where the call fails, and nobody
 * may render with it meanwhile. LR_E_ARGUMENT for a method without lights, LR_E_MEMORY,
 * LR_E_STOPPED. */
LR_API lr_status lr_prepared_light(lr_prepared *prepared, int32_t index,
                                   const lr_image_light *light, const lr_watch *watch,
                                   lr_error *error);

/* How many surface voxels are kept in prepared, of a method with LR_IMAGE_LIGHTS; 0 of others. Then
 * what is kept of each, into arrays of that many: cell[n][3], unit normal[n][3] in object space (0:
 * none), linear color[n][3], and in lit[n] a bit for each light that the voxel sees. */
LR_API uint64_t lr_prepared_voxel_count(const lr_prepared *prepared);
LR_API void lr_prepared_voxels(const lr_prepared *prepared, int32_t *cell, double *normal,
                               double *color, uint32_t *lit);

typedef enum lr_pixel {
    LR_PIXEL_MISS = 0,
    LR_PIXEL_HIT = 1,
    LR_PIXEL_SKIPPED = 2 /* a miss that was known without a ray of its own */
} lr_pixel;

/* What lies behind the pixels' centres; all but the first three may be NULL. */
typedef struct lr_image {
    int32_t x, y, width, height; /* pixels of the film; row 0 is the lowest */
    double *t;                   /* [height][width], depth along forward; infinity on a miss */
    int32_t *cell;               /* [height][width][3]; the least int32_t on a miss */
    uint8_t *pixel;              /* [height][width], lr_pixel */
    double *shade;               /* [height][width][3], linear RGB; 0 on a miss. Without lights
                                    (far - t) / (far - near), of the box of the surface */
    double *normal;              /* [height][width][3], unit, object space; 0 on a miss. Only where
                                    the method has LR_IMAGE_LIGHTS */
    double *empty;               /* [height][width][2]: for the next frame. Only where the method
                                    has LR_IMAGE_FRAMES */
} lr_image;

/* The frame before: the camera and all that its image kept in `empty`. */
typedef struct lr_frame_before {
    lr_camera camera;
    int32_t width, height; /* of the whole film, from its corner */
    const double *empty;   /* [height][width][2] */
} lr_frame_before;

/* Render the pixels that image names, by the method of prepared. camera: in object space. before:
 * NULL, or for a method with LR_IMAGE_FRAMES the frame before, of the same volume. Parts of a film
 * may be asked for side by side. counters is added to; NULL costs nothing. LR_E_ARGUMENT for a
 * camera that the method does not take, LR_E_MEMORY, LR_E_STOPPED. */
LR_API lr_status lr_render_image(const lr_prepared *prepared, const lr_camera *camera,
                                 const lr_frame_before *before, const lr_image *image,
                                 lr_counters *counters, const lr_watch *watch, lr_error *error);

#endif
