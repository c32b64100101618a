/* Closures.
 *
 * Light that several microfacets scatter is added as a factor of the single bounce, tinted
 * for the mean number of bounces. A dielectric layer over a diffuse base transmits what it
 * does not reflect towards the viewer.
 *
 * Source: the layers and their order are those of Blender's manual for the
 * Principled BSDF; Turquin, Practical multiple scattering compensation for
 * microfacet models, 2019; Kulla and Conty, Revisiting physically based shading at
 * Imageworks, 2017 (mean Fresnel, colour of several bounces); Kutz, Hasan,
 * Edmondson, Novel aspects of the Adobe Standard Material, 2023 (F82-tint).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/bsdf/bsdf.h"

#include "render/bsdf/albedo_glass.h"
#include "render/bsdf/ggx.h"
#include "render/bsdf/oren_nayar.h"

/* How facets reflect. */
enum {
    FRESNEL_NONE, /* all light; if the closure refracts: nothing but total internal reflection */
    FRESNEL_CONDUCTOR, /* Schlick's curve from f0 to 1, less the F82 term */
    FRESNEL_DIELECTRIC /* the curve of a dielectric of index n, stretched to f0..1 */
};

/* Below it facets are as good as a mirror: their lobe is narrower than 1/100 of a degree. */
static const double ALPHA_MIN = 1e-5;

/* Below this difference of the index from 1, light is not refracted. */
static const double INDEX_MIN = 1e-4;

/* Rare facets may refract where most do not, above all from inside: the least albedo of
 * closures of facets. */
static const double ALBEDO_MIN = 0.05, ALBEDO_MIN_OUT = 0.2;

/* The least value of lr_closure.guide, since it is estimated from a few facets. */
static const double GUIDE_MIN = 0.02;

/* ---- albedo --------------------------------------------------------------- */

typedef struct lr_place {
    int32_t at;
    double t;
} lr_place;

static lr_place place(double x, int32_t n)
{
    const double y = lr_clamp(x, 0, 1) * (n - 1);
    const int32_t at = lr_min_i((int32_t)y, n - 2);
    return (lr_place){at, y - at};
}

static double mix(double a, double b, double t)
{
    return a + (b - a) * t;
}

static double mirror_albedo(double rough, double mu)
{
    const lr_place r = place(rough, LR_ALBEDO_FINE), m = place(mu, LR_ALBEDO_FINE);
    const uint16_t *a = &lr_albedo_mirror[r.at][m.at], *b = &lr_albedo_mirror[r.at + 1][m.at];
    return mix(mix(a[0], a[1], m.t), mix(b[0], b[1], m.t), r.t) / 65535;
}

static double mirror_albedo_mean(double rough)
{
    const lr_place r = place(rough, LR_ALBEDO_FINE);
    const uint16_t *a = &lr_albedo_mirror_mean[r.at];
    return mix(a[0], a[1], r.t) / 65535;
}

static double look_up(const uint16_t table[LR_ALBEDO_COARSE][LR_ALBEDO_COARSE][LR_ALBEDO_COARSE],
                      double rough, double mu, double n)
{
    const lr_place r = place(rough, LR_ALBEDO_COARSE), m = place(mu, LR_ALBEDO_COARSE);
    const lr_place z = place(sqrt(fabs((n - 1) / (n + 1))), LR_ALBEDO_COARSE);
    double of_r[2];
    for (int i = 0; i < 2; i++) {
        const uint16_t *a = &table[r.at + i][m.at][z.at], *b = &table[r.at + i][m.at + 1][z.at];
        of_r[i] = mix(mix(a[0], a[1], z.t), mix(b[0], b[1], z.t), m.t);
    }
    return mix(of_r[0], of_r[1], r.t) / 65535;
}

static double look_up_mean(const uint16_t table[LR_ALBEDO_COARSE][LR_ALBEDO_COARSE], double rough,
                           double n)
{
    const lr_place r = place(rough, LR_ALBEDO_COARSE);
    const lr_place z = place(sqrt(fabs((n - 1) / (n + 1))), LR_ALBEDO_COARSE);
    const uint16_t *a = &table[r.at][z.at], *b = &table[r.at + 1][z.at];
    return mix(mix(a[0], a[1], z.t), mix(b[0], b[1], z.t), r.t) / 65535;
}

/* ---- Fresnel -------------------------------------------------------------- */

/* Reflectance of a facet under that cosine. */
static void reflectance(const lr_closure *c, double cosine, double f[3])
{
    const double x = 1 - cosine, x5 = x * x * x * x * x;
    double s = 1;
    if (c->fresnel == FRESNEL_CONDUCTOR)
        s = x5;
    else if (c->fresnel == FRESNEL_DIELECTRIC) {
        const double least = lr_fresnel_0(c->n);
        s = lr_clamp((lr_fresnel(cosine, c->n) - least) / (1 - least), 0, 1);
    }
    for (int a = 0; a < 3; a++)
        f[a] = lr_clamp(mix(c->f0[a], 1, s) - c->f82[a] * cosine * x5 * x, 0, 1);
}

/* The light that a facet under that cosine scatters by this closure, as a fraction. */
static void passed(const lr_closure *c, double cosine, double f[3])
{
    if (c->fresnel == FRESNEL_NONE) {
        f[0] = f[1] = f[2] = 1;
        return;
    }
    reflectance(c, cosine, f);
    for (int a = 0; a < 3 && c->kind == LR_RAY_TRANSMISSION; a++)
        f[a] = 1 - f[a];
}

/* Mean reflectance over the hemisphere of a smooth dielectric: Kulla and Conty's fit. */
static double fresnel_mean(double n)
{
    return n < 1 ? 0.997118 + n * (0.1014 - n * (0.965241 + n * 0.130607))
                 : (n - 1) / (4.08567 + 1.00071 * n);
}

/* ---- closures ------------------------------------------------------------- */

static double mean(const double c[3])
{
    return (c[0] + c[1] + c[2]) / 3;
}

/* Facets that are tried at a time: a lattice of the unit square, whose facet i lies i quarters of a
 * turn further, and so much in v. */
enum { FACETS = 4 };
static const double LATTICE[FACETS] = {0.0, 0.5, 0.25, 0.75};

/* Facets from the lattice shifted by a turn, its cosine and sine, and v: normals, the fraction that
 * each scatters, and its mean. */
static double try_facets(const lr_closure *c, const double view[3], const double turn[2], double v,
                         double h[FACETS][3], double sent[FACETS])
{
    const double x = turn[0], y = turn[1];
    const double turns[FACETS][2] = {{x, y}, {-y, x}, {-x, -y}, {y, -x}};
    double sum = 0;
    for (int i = 0; i < FACETS; i++) {
        const double w = v + LATTICE[i];
        double f[3];
        lr_ggx_sample(c->alpha, view, turns[i], w < 1 ? w : w - 1, h[i]);
        passed(c, lr_dot(view, h[i]), f);
        sum += sent[i] = mean(f);
    }
    return sum / FACETS;
}

/* Add a closure, with the albedo by which it is chosen: about its own, as seen. */
static void enlist(lr_bsdf *bsdf, lr_closure *c)
{
    const double least = c->alpha == 0 ? 0 : c->n < 1 ? ALBEDO_MIN_OUT : ALBEDO_MIN;
    double f[3] = {1, 1, 1};
    c->guide = 0;
    if (c->fresnel == FRESNEL_DIELECTRIC && c->alpha > 0) {
        static const double eighth[2] = {0.70710678118654752, 0.70710678118654752};
        double h[FACETS][3], sent[FACETS];
        c->guide = fmax(try_facets(c, bsdf->basis.view, eighth, 0.125, h, sent), GUIDE_MIN);
        f[0] = f[1] = f[2] = c->guide;
    } else if (c->kind != LR_RAY_DIFFUSE)
        passed(c, bsdf->basis.view[2], f);
    c->albedo = 0;
    for (int a = 0; a < 3; a++)
        c->albedo += c->weight[a] * fmax(f[a], least) / 3;
    if (c->albedo > 0 && bsdf->n < LR_CLOSURES_MAX) {
        bsdf->albedo[c->kind] += c->albedo;
        bsdf->closures[bsdf->n++] = *c;
    }
}

static lr_closure closure(int32_t kind, const double weight[3], double roughness)
{
    lr_closure c = {.kind = kind, .n = 1, .alpha = roughness * roughness};
    memcpy(c.weight, weight, sizeof c.weight);
    if (c.alpha < ALPHA_MIN)
        c.alpha = 0;
    return c;
}

/* Several bounces between facets, as a factor of the single bounce. e, e_mean: albedo of white
 * facets for one bounce, as seen and in the mean; tint: the light left by a bounce. */
static double between(double e, double e_mean, double tint)
{
    return 1 + tint * e_mean / (1 - tint * (1 - e_mean)) * (1 - e) / e;
}

/* Scale a closure that reflects by that factor. */
static void give_back(const lr_bsdf *bsdf, lr_closure *c, const double tint[3])
{
    const double rough = sqrt(c->alpha);
    const double e = mirror_albedo(rough, bsdf->basis.view[2]), e_mean = mirror_albedo_mean(rough);
    for (int a = 0; a < 3; a++)
        c->weight[a] *= between(e, e_mean, tint[a]);
}

static void add_diffuse(lr_bsdf *bsdf, const double weight[3], double rough, const double tint[3])
{
    lr_closure c = {.kind = LR_RAY_DIFFUSE, .alpha = 1, .n = rough};
    memcpy(c.weight, weight, sizeof c.weight);
    for (int a = 0; a < 3; a++)
        c.f0[a] =
            lr_oren_nayar_multiple(rough, lr_bsdf_basis(bsdf, LR_RAY_DIFFUSE)->view[2], tint[a]);
    enlist(bsdf, &c);
}

static void add_glossy(lr_bsdf *bsdf, const lr_lobe *lobe, const double weight[3],
                       const double tint[3])
{
    lr_closure c = closure(LR_RAY_GLOSSY, weight, lobe->roughness);
    if (lobe->flags & LR_LOBE_MULTISCATTER)
        give_back(bsdf, &c, tint);
    enlist(bsdf, &c);
}

static void add_metal(lr_bsdf *bsdf, const lr_lobe *lobe, const double weight[3],
                      const double color[3])
{
    lr_closure c = closure(LR_RAY_GLOSSY, weight, lobe->roughness);
    /* The tint's curve touches Schlick's times the tint where the cosine is 1/7. */
    const double f = 6.0 / 7.0, f5 = f * f * f * f * f;
    double once[3];
    c.fresnel = FRESNEL_CONDUCTOR;
    for (int a = 0; a < 3; a++) {
        c.f0[a] = fmin(color[a], 1);
        c.f82[a] = mix(c.f0[a], 1, f5) * (7 / (f5 * f)) * (1 - fmin(lobe->specular_tint[a], 1));
        once[a] = lr_clamp(mix(c.f0[a], 1, 1.0 / 21) - c.f82[a] / 126, 0, 1);
    }
    if (lobe->flags & LR_LOBE_MULTISCATTER)
        give_back(bsdf, &c, once);
    enlist(bsdf, &c);
}

/* A dielectric that reflects and refracts. facing: the colour of its reflection at normal
 * incidence; tint: that of its transmission. */
static void add_glass(lr_bsdf *bsdf, const lr_lobe *lobe, double n, const double reflected[3],
                      const double refracted[3], const double facing[3], const double tint[3])
{
    lr_closure c = closure(LR_RAY_GLOSSY, reflected, lobe->roughness);
    c.fresnel = FRESNEL_DIELECTRIC;
    c.n = n;
    if (fabs(n - 1) < INDEX_MIN)
        c.alpha = 0;
    for (int a = 0; a < 3; a++)
        c.f0[a] = fmin(lr_fresnel_0(n) * facing[a], 1);
    double scale[3] = {1, 1, 1};
    for (int a = 0; a < 3 && (lobe->flags & LR_LOBE_MULTISCATTER) && c.alpha > 0; a++) {
        const double rough = sqrt(c.alpha);
        scale[a] = between(look_up(lr_albedo_glass[n < 1], rough, bsdf->basis.view[2], n),
                           look_up_mean(lr_albedo_glass_mean[n < 1], rough, n), tint[a]);
    }
    for (int a = 0; a < 3; a++)
        c.weight[a] = scale[a] * reflected[a];
    enlist(bsdf, &c);
    c.kind = LR_RAY_TRANSMISSION;
    for (int a = 0; a < 3; a++)
        c.weight[a] = scale[a] * refracted[a];
    enlist(bsdf, &c);
}

static void add_refraction(lr_bsdf *bsdf, const lr_lobe *lobe, double n, const double weight[3])
{
    lr_closure c = closure(LR_RAY_TRANSMISSION, weight, lobe->roughness);
    c.n = n;
    if (fabs(n - 1) < INDEX_MIN)
        c.alpha = 0;
    enlist(bsdf, &c);
}

/* A dielectric layer; *below is reduced by what it reflects. */
static void add_coat(lr_bsdf *bsdf, const lr_lobe *lobe, double *below)
{
    double f0 = lr_fresnel_0(lobe->ior), n = lobe->ior;
    if (lobe->specular != 0.5) {
        f0 = fmin(2 * lobe->specular * f0, 0.99);
        n = (1 + sqrt(f0)) / (1 - sqrt(f0));
        if (lobe->ior < 1)
            n = 1 / n;
    }
    if (fabs(n - 1) < INDEX_MIN)
        return;
    const double weight[3] = {*below, *below, *below};
    lr_closure c = closure(LR_RAY_GLOSSY, weight, lobe->roughness);
    c.fresnel = FRESNEL_DIELECTRIC;
    c.n = n;
    const double s = lr_clamp((fresnel_mean(n) - f0) / (1 - f0), 0, 1);
    const double schlick = look_up(lr_albedo_dielectric, lobe->roughness, bsdf->basis.view[2], n);
    double once[3], sent = 1, most = 0;
    for (int a = 0; a < 3; a++) {
        c.f0[a] = fmin(f0 * lobe->specular_tint[a], 1);
        once[a] = mix(c.f0[a], 1, s);
    }
    if (lobe->flags & LR_LOBE_MULTISCATTER) {
        give_back(bsdf, &c, once);
        sent = mirror_albedo(lobe->roughness, bsdf->basis.view[2]);
    } /* else light lost between facets does not get below, as in Cycles */
    for (int a = 0; a < 3; a++)
        most = fmax(most, c.weight[a] * sent * mix(c.f0[a], 1, schlick));
    enlist(bsdf, &c);
    *below = fmax(*below - most, 0);
}

/* The layers from above: alpha, emission, metal, glass, reflection, diffuse base. */
static void add_principled(lr_bsdf *bsdf, const lr_lobe *lobe, double n, const double color[3])
{
    double rest = lobe->weight * lobe->alpha;
    double w[3], tint[3], through[3];
    for (int a = 0; a < 3; a++) {
        bsdf->transparency[a] += lobe->weight * (1 - lobe->alpha);
        bsdf->emission[a] += rest * lobe->emission[a];
        w[a] = rest * lobe->metallic;
    }
    if (lobe->metallic > 0)
        add_metal(bsdf, lobe, w, color);
    rest *= 1 - lobe->metallic;
    for (int a = 0; a < 3; a++) {
        w[a] = rest * lobe->transmission;
        tint[a] = sqrt(fmin(color[a], 1));
        through[a] = w[a] * tint[a];
    }
    if (w[0] > 0)
        add_glass(bsdf, lobe, n, w, through, lobe->specular_tint, tint);
    rest *= 1 - lobe->transmission;
    if (rest > 0)
        add_coat(bsdf, lobe, &rest);
    for (int a = 0; a < 3; a++)
        w[a] = rest * color[a];
    add_diffuse(bsdf, w, 0, w);
}

static void add(lr_bsdf *bsdf, const lr_lobe *lobe, const lr_material *material,
                const lr_point *point)
{
    double n = point->inside ? 1 / lobe->ior : lobe->ior;
    if (point->eta > 0) {
        const double scale = lobe->ior / material->ior;
        n = (point->inside ? 1 / scale : scale) / point->eta;
    }
    double color[3], tint[3], weight[3];
    for (int a = 0; a < 3; a++) {
        color[a] = lobe->color[a] * (lobe->flags & LR_LOBE_TEXTURED ? point->color[a] : 1);
        tint[a] = fmin(color[a], 1);
        weight[a] = color[a] * lobe->weight;
    }
    static const double white[3] = {1, 1, 1};
    switch (lobe->kind) {
    case LR_LOBE_DIFFUSE:
        add_diffuse(bsdf, weight, lobe->roughness, tint);
        break;
    case LR_LOBE_GLOSSY:
        add_glossy(bsdf, lobe, weight, tint);
        break;
    case LR_LOBE_GLASS:
        add_glass(bsdf, lobe, n, weight, weight, white, tint);
        break;
    case LR_LOBE_REFRACTION:
        add_refraction(bsdf, lobe, n, weight);
        break;
    case LR_LOBE_TRANSPARENT:
        for (int a = 0; a < 3; a++)
            bsdf->transparency[a] += weight[a];
        break;
    case LR_LOBE_EMISSION:
        for (int a = 0; a < 3; a++)
            bsdf->emission[a] += weight[a];
        break;
    default:
        add_principled(bsdf, lobe, n, color);
    }
}

static void set_frames(lr_bsdf *bsdf, const lr_point *point)
{
    double n[3];
    memcpy(n, point->normal, sizeof n);
    bsdf->bent = point->bends && lr_bend(point->facing, point->view, n);
    lr_turn_back(point->view, n);
    lr_basis_set(&bsdf->basis, n, point->view);
    if (!bsdf->bent)
        return;
    lr_basis_set(&bsdf->unbent, point->normal, point->view);
    bsdf->unbent.view[2] = fmax(bsdf->unbent.view[2], 0);
}

void lr_bsdf_normal(const lr_bsdf *bsdf, double normal[3])
{
    const double diffuse = bsdf->bent ? bsdf->albedo[LR_RAY_DIFFUSE] : 0;
    const double facets = bsdf->albedo[LR_RAY_GLOSSY] + bsdf->albedo[LR_RAY_TRANSMISSION];
    memcpy(normal, bsdf->basis.axis[2], 3 * sizeof *normal);
    if (!(diffuse > 0))
        return;
    for (int a = 0; a < 3; a++)
        normal[a] = facets * bsdf->basis.axis[2][a] + diffuse * bsdf->unbent.axis[2][a];
    const double length = sqrt(lr_dot(normal, normal));
    for (int a = 0; a < 3; a++)
        normal[a] /= length;
}

void lr_bsdf_at(const lr_material *material, const lr_point *point, lr_bsdf *bsdf)
{
    bsdf->n = 0;
    memset(bsdf->albedo, 0, sizeof bsdf->albedo);
    memset(bsdf->emission, 0, sizeof bsdf->emission);
    memset(bsdf->transparency, 0, sizeof bsdf->transparency);
    set_frames(bsdf, point);
    for (uint32_t i = 0; i < material->n_lobes; i++)
        if (material->lobes[i].weight > 0)
            add(bsdf, &material->lobes[i], material, point);
    bsdf->albedo[LR_RAY_TRANSPARENT] = mean(bsdf->transparency);
}

/* ---- responses ------------------------------------------------------------ */

/* The response of one closure, not of a single direction, to light in the normal's frame. */
static bool respond(const lr_closure *c, const double view[3], const double light[3],
                    lr_response *r)
{
    const bool through = c->kind == LR_RAY_TRANSMISSION;
    if (c->alpha == 0 || (through ? light[2] >= 0 : light[2] <= 0))
        return false;
    if (c->kind == LR_RAY_DIFFUSE) {
        r->pdf = light[2] / LR_PI;
        for (int a = 0; a < 3; a++)
            r->f_cos[a] = c->weight[a] * r->pdf * lr_oren_nayar(c->n, c->f0[a], view, light);
        return true;
    }
    const double n = through ? c->n : 1;
    double h[3], f[3];
    for (int a = 0; a < 3; a++)
        h[a] = view[a] + n * light[a];
    const double length = copysign(sqrt(lr_dot(h, h)), h[2]);
    for (int a = 0; a < 3; a++)
        h[a] /= length;
    const double c_view = lr_dot(view, h), c_light = lr_dot(light, h);
    if (!(c_view > 0) || (through ? c_light >= 0 : c_light <= 0))
        return false;
    const double bent = c_view + n * c_light;
    const double stretch = through ? c_view * -c_light * n * n / (bent * bent) : 0.25;
    const double visible = lr_ggx_d(c->alpha, h) * stretch / view[2];
    const double of_view = lr_ggx_lambda(c->alpha, view[2]);
    r->pdf = visible / (1 + of_view);
    passed(c, c_view, f);
    if (c->guide > 0)
        r->pdf *= mean(f) / c->guide;
    for (int a = 0; a < 3; a++)
        f[a] *= c->weight[a] * visible / (1 + of_view + lr_ggx_lambda(c->alpha, light[2]));
    memcpy(r->f_cos, f, sizeof f);
    return true;
}

/* All closures of a group but those of a single direction; densities weighted by albedo. */
static void respond_all(const lr_bsdf *bsdf, int32_t kind, const double light[3], lr_response *sum)
{
    *sum = (lr_response){{0, 0, 0}, 0};
    for (uint32_t i = 0; i < bsdf->n; i++) {
        const lr_closure *c = &bsdf->closures[i];
        lr_response r;
        if (c->kind != kind || !respond(c, lr_bsdf_basis(bsdf, kind)->view, light, &r))
            continue;
        for (int a = 0; a < 3; a++)
            sum->f_cos[a] += r.f_cos[a];
        sum->pdf += r.pdf * c->albedo / bsdf->albedo[kind];
    }
}

void lr_bsdf_eval(const lr_bsdf *bsdf, const double light[3], lr_response group[LR_GROUPS])
{
    for (int32_t kind = 1; kind <= LR_GROUPS; kind++) {
        const lr_basis *b = lr_bsdf_basis(bsdf, kind);
        const double local[3] = {lr_dot(b->axis[0], light), lr_dot(b->axis[1], light),
                                 lr_dot(b->axis[2], light)};
        respond_all(bsdf, kind, local, &group[kind - 1]);
    }
}

/* ---- sampling ------------------------------------------------------------- */

/* A closure of the group, chosen by its albedo; u is stretched to 0..1 again. */
static const lr_closure *choose(const lr_bsdf *bsdf, int32_t kind, double *u)
{
    const lr_closure *last = NULL;
    double x = *u * bsdf->albedo[kind];
    for (uint32_t i = 0; i < bsdf->n; i++) {
        const lr_closure *c = &bsdf->closures[i];
        if (c->kind != kind)
            continue;
        last = c;
        *u = fmin(x / c->albedo, 1 - 0x1p-53);
        if (x < c->albedo)
            break;
        x -= c->albedo;
    }
    return last;
}

/* A facet visible from view; *scale compensates its selection. Facets of a dielectric are
 * chosen among a few, weighted by what they scatter: Talbot, Cline, Egbert, Importance resampling
 * for global illumination, 2005. */
static bool pick_facet(const lr_closure *c, const double view[3], const double u[2], double pick,
                       double h[3], double *scale)
{
    const double turn[2] = {cos(2 * LR_PI * u[0]), sin(2 * LR_PI * u[0])};
    *scale = 1;
    if (!(c->guide > 0)) {
        lr_ggx_sample(c->alpha, view, turn, u[1], h);
        return true;
    }
    double facets[FACETS][3], sent[FACETS];
    const double all = try_facets(c, view, turn, u[1], facets, sent);
    double x = pick * all * FACETS;
    int at = 0;
    while (at < FACETS - 1 && x >= sent[at])
        x -= sent[at++];
    *scale = all / sent[at];
    memcpy(h, facets[at], sizeof facets[at]);
    return sent[at] > 0;
}

/* Sample a direction of one closure, with its weight. */
static bool follow(const lr_closure *c, const double view[3], const double u[2], double pick,
                   double light[3], double weight[3])
{
    if (c->kind == LR_RAY_DIFFUSE) {
        const double r = sqrt(u[0]);
        light[0] = r * cos(2 * LR_PI * u[1]);
        light[1] = r * sin(2 * LR_PI * u[1]);
        light[2] = sqrt(1 - u[0]);
        for (int a = 0; a < 3; a++)
            weight[a] = c->weight[a] * lr_oren_nayar(c->n, c->f0[a], view, light);
        return light[2] > 0;
    }
    double h[3] = {0, 0, 1}, scale = 1;
    if (c->alpha > 0 && !pick_facet(c, view, u, pick, h, &scale))
        return false;
    if (c->kind == LR_RAY_TRANSMISSION) {
        if (!lr_refract(view, h, c->n, light) || light[2] >= 0)
            return false;
    } else {
        lr_reflect(view, h, light);
        if (light[2] <= 0)
            return false;
    }
    if (c->alpha > 0) {
        const double of_view = 1 + lr_ggx_lambda(c->alpha, view[2]);
        scale *= of_view / (of_view + lr_ggx_lambda(c->alpha, light[2]));
    }
    passed(c, lr_dot(view, h), weight);
    for (int a = 0; a < 3; a++)
        weight[a] *= scale * c->weight[a];
    return true;
}

bool lr_bsdf_sample(const lr_bsdf *bsdf, int32_t kind, const double u[3], lr_scatter *scatter)
{
    if (kind < LR_RAY_DIFFUSE || kind > LR_RAY_TRANSMISSION || !(bsdf->albedo[kind] > 0))
        return false;
    double pick = u[2], light[3];
    const lr_basis *b = lr_bsdf_basis(bsdf, kind);
    const lr_closure *c = choose(bsdf, kind, &pick);
    if (c == NULL || !follow(c, b->view, u, pick, light, scatter->weight))
        return false;
    scatter->kind = kind;
    scatter->delta = c->alpha == 0;
    scatter->pdf = 1;
    for (int a = 0; a < 3; a++) {
        scatter->weight[a] *= bsdf->albedo[kind] / c->albedo;
        scatter->direction[a] =
            light[0] * b->axis[0][a] + light[1] * b->axis[1][a] + light[2] * b->axis[2][a];
    }
    if (!scatter->delta) {
        lr_response r;
        respond_all(bsdf, kind, light, &r);
        scatter->pdf = r.pdf;
    }
    return scatter->pdf > 0;
}
