/* The BSDF at one point of a surface, for one viewing direction.
 *
 * A material's lobes become closures: diffuse, reflecting, refracting. They are grouped by
 * the kind of ray that they scatter; each group is sampled and evaluated by itself.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_BSDF_BSDF_H
#define LR_RENDER_BSDF_BSDF_H

#include "render/bsdf/material.h"
#include "render/bsdf/shading_frame.h"

/* Groups of closures are numbered by the rays that they scatter, lr_ray_kind. */
enum { LR_GROUPS = 3, LR_CLOSURES_MAX = 4 * LR_LOBES_MAX };

/* A point of a surface, in world space. */
typedef struct lr_point {
    double view[3];   /* unit, towards the viewer */
    double normal[3]; /* unit, for shading; turned to the viewer's side */
    double facing[3]; /* unit, of the surface itself; turned to the viewer's side */
    bool bends;       /* a flat face has this normal of its own: see lr_bsdf */
    double color[3];  /* of textures or vertex colours; multiplies textured lobes */
    double eta;       /* index of the viewer's side over that of the far side, for a lobe with the
                         material's ior; 0: the surface lies in a void */
    bool inside;      /* seen from within */
} lr_point;

/* A sampled direction. */
typedef struct lr_scatter {
    double direction[3]; /* unit, away from the surface */
    double weight[3];    /* the group's radiance to the viewer is the mean of weight x light */
    double pdf;          /* about its density, as in lr_response; 1 for a single direction */
    int32_t kind;        /* lr_ray_kind */
    bool delta;          /* a single direction, which no light sample hits */
} lr_scatter;

/* Response of a group to light from a direction. */
typedef struct lr_response {
    double f_cos[3];
    double pdf; /* about the density of lr_bsdf_sample, per solid angle */
} lr_response;

typedef struct lr_closure {
    int32_t kind;    /* lr_ray_kind of its rays */
    int32_t fresnel; /* how facets reflect: see bsdf.c */
    double weight[3];
    double alpha; /* of GGX; 0: a single direction */
    double n; /* index of the far side over that of the near side; of diffuse ones the roughness */
    double f0[3];  /* reflectance at normal incidence; of diffuse ones what comes back by several
                      bounces, as Fujii's model has it */
    double f82[3]; /* F82 term: what the conductor lacks of Schlick's curve near 82 degrees */
    double albedo; /* about; its probability in its group is in proportion to it */
    double guide;  /* mean fraction that facets scatter, if they are chosen by it; else 0 */
} lr_closure;

/* The normals of a flat face may lean so far that reflections would go into the face, or that
 * they face away from the viewer. Then closures of facets use normals that are bent towards
 * the face as far as needed; diffuse closures keep the original ones. */
typedef struct lr_bsdf {
    lr_basis basis;                   /* of the normal, bent where it must be */
    lr_basis unbent;                  /* of the normal as it is, where that is not the same */
    bool bent;                        /* it is not */
    double albedo[LR_RAY_VOLUME + 1]; /* by lr_ray_kind: of the group, about; 0: there is none */
    double emission[3];               /* radiance */
    double transparency[3];           /* what goes straight through */
    uint32_t n;
    lr_closure *closures; /* with room for LR_CLOSURES_MAX while they are made */
} lr_bsdf;

/* Writes all but the place of the closures. */
void lr_bsdf_at(const lr_material *material, const lr_point *point, lr_bsdf *bsdf);

/* The frame of the closures of a kind. */
LR_INLINE const lr_basis *lr_bsdf_basis(const lr_bsdf *bsdf, int32_t kind)
{
    return bsdf->bent && kind == LR_RAY_DIFFUSE ? &bsdf->unbent : &bsdf->basis;
}

/* Unit: the mean of the closures' normals, weighted by albedo. */
void lr_bsdf_normal(const lr_bsdf *bsdf, double normal[3]);

/* A direction of one group (diffuse, glossy or transmission); false where the light
 * is lost. u: three numbers in 0..1, 1 not included. */
bool lr_bsdf_sample(const lr_bsdf *bsdf, int32_t kind, const double u[3], lr_scatter *scatter);

/* The groups' responses to light from a direction, by lr_ray_kind - 1; single
 * directions have none. */
void lr_bsdf_eval(const lr_bsdf *bsdf, const double light[3], lr_response group[LR_GROUPS]);

#endif
