# Generated from include/leapray.h by generate_abi.py; do not edit.
# SPDX-License-Identifier: GPL-3.0-or-later
"""The public C interface as ctypes: constants, enums, structs, prototypes.

ABOUT is what the header says of the members of enums.
"""

import ctypes
from enum import IntEnum

LR_VERSION = "0.1.0"
LR_ABI = 41
LR_PROGRAM_REGISTERS = 256
LR_EUCLID_MAX = 26754
LR_BOUNCES_MAX = 1024
LR_LOBES_MAX = 8
LR_OWN_INDEX = -2147483647
LR_BRANCHES_MAX = 16
LR_IMAGE_LIGHTS_MAX = 32


class lr_status(IntEnum):
    LR_OK = 0
    LR_E_ARGUMENT = 1
    LR_E_SIZE = 2
    LR_E_MEMORY = 3
    LR_E_STOPPED = 4


class lr_sample_type(IntEnum):
    LR_U8 = 0
    LR_U16 = 1
    LR_F32 = 2


class lr_kind(IntEnum):
    LR_KIND_AUTO = 0
    LR_KIND_SOLID = 1
    LR_KIND_SHEET = 2


class lr_volume_interpolation(IntEnum):
    LR_VOLUME_LINEAR = 0
    LR_VOLUME_CUBIC = 1


class lr_number_type(IntEnum):
    LR_NUMBER_U8 = 0
    LR_NUMBER_I8 = 1
    LR_NUMBER_U16 = 2
    LR_NUMBER_I16 = 3
    LR_NUMBER_U32 = 4
    LR_NUMBER_I32 = 5
    LR_NUMBER_F32 = 6
    LR_NUMBER_F64 = 7


class lr_operation(IntEnum):
    LR_OP_ADD = 0
    LR_OP_SUBTRACT = 1
    LR_OP_MULTIPLY = 2
    LR_OP_DIVIDE = 3
    LR_OP_MULTIPLY_ADD = 4
    LR_OP_POWER = 5
    LR_OP_LOGARITHM = 6
    LR_OP_SQRT = 7
    LR_OP_INVERSE_SQRT = 8
    LR_OP_ABSOLUTE = 9
    LR_OP_EXPONENT = 10
    LR_OP_MINIMUM = 11
    LR_OP_MAXIMUM = 12
    LR_OP_LESS_THAN = 13
    LR_OP_GREATER_THAN = 14
    LR_OP_COMPARE = 15
    LR_OP_SIGN = 16
    LR_OP_SMOOTH_MIN = 17
    LR_OP_ROUND = 18
    LR_OP_FLOOR = 19
    LR_OP_CEIL = 20
    LR_OP_TRUNC = 21
    LR_OP_FRACT = 22
    LR_OP_MODULO = 23
    LR_OP_FLOORED_MODULO = 24
    LR_OP_WRAP = 25
    LR_OP_PINGPONG = 26
    LR_OP_SINE = 27
    LR_OP_COSINE = 28
    LR_OP_TANGENT = 29
    LR_OP_ARCSINE = 30
    LR_OP_ARCCOSINE = 31
    LR_OP_ARCTANGENT = 32
    LR_OP_ARCTAN2 = 33
    LR_OP_SINH = 34
    LR_OP_COSH = 35
    LR_OP_TANH = 36
    LR_OP_SELECT = 37
    LR_OP_FROM_SRGB = 38
    LR_OP_TABLE = 39


class lr_table_kind(IntEnum):
    LR_TABLE_LINEAR = 0
    LR_TABLE_CONSTANT = 1
    LR_TABLE_EXTRAPOLATE = 2


class lr_interpolation(IntEnum):
    LR_INTERPOLATION_LINEAR = 0
    LR_INTERPOLATION_CLOSEST = 1
    LR_INTERPOLATION_CUBIC = 2


class lr_extension(IntEnum):
    LR_EXTENSION_REPEAT = 0
    LR_EXTENSION_EXTEND = 1
    LR_EXTENSION_CLIP = 2
    LR_EXTENSION_MIRROR = 3


class lr_color_source(IntEnum):
    LR_COLOR_NONE = -2
    LR_COLOR_VERTEX = -1


class lr_filter(IntEnum):
    LR_FILTER_RAMP = 0
    LR_FILTER_BOX = 1
    LR_FILTER_CONE = 2
    LR_FILTER_GAUSS = 3
    LR_FILTER_BINARY = 4


class lr_simd(IntEnum):
    LR_SIMD_AUTO = 0
    LR_SIMD_PORTABLE = 1
    LR_SIMD_AVX2 = 2
    LR_SIMD_AVX512 = 3


class lr_exact_cells(IntEnum):
    LR_EXACT_SHEETS = 0
    LR_EXACT_ALL = 1
    LR_EXACT_NONE = 2
    LR_EXACT_EVERY = 3


class lr_stage(IntEnum):
    LR_STAGE_NONE = 0
    LR_STAGE_SET_UP = 1
    LR_STAGE_COMPONENTS = 2
    LR_STAGE_WINDING = 3
    LR_STAGE_BRICKS = 4
    LR_STAGE_CELLS = 5
    LR_STAGE_DONE = 6


class lr_reason(IntEnum):
    LR_REASON_ASKED = 0
    LR_REASON_CLOSED = 1
    LR_REASON_CROSSING = 2
    LR_REASON_ENCLOSES = 3
    LR_REASON_HOLES = 4
    LR_REASON_FLIPPED = 5
    LR_REASON_EMPTY = 6


class lr_metric(IntEnum):
    LR_METRIC_CHESSBOARD = 0
    LR_METRIC_CITYBLOCK = 1
    LR_METRIC_CHAMFER345 = 2
    LR_METRIC_EUCLID = 3


class lr_traverser_flag(IntEnum):
    LR_TRAVERSER_EXACT = 1
    LR_TRAVERSER_DEFAULT = 2
    LR_TRAVERSER_RECTILINEAR = 4
    LR_TRAVERSER_TRIAL = 8


class lr_mode(IntEnum):
    LR_MODE_SURFACE = 0
    LR_MODE_BINARY = 1
    LR_MODE_VOLUME = 2
    LR_MODE_MAXIMUM = 3
    LR_MODE_MINIMUM = 4
    LR_MODE_MEAN = 5


class lr_sampling(IntEnum):
    LR_SAMPLING_EXACT = 0
    LR_SAMPLING_POST = 1
    LR_SAMPLING_PRE = 2


class lr_hit_test(IntEnum):
    LR_HIT_EXTREMA = 1
    LR_HIT_FACES = 0
    LR_HIT_UNIFORM = 2


class lr_root(IntEnum):
    LR_ROOT_NEWTON = 0
    LR_ROOT_BISECT = 2
    LR_ROOT_CUBIC = 3
    LR_ROOT_LINEAR = 1


class lr_normal(IntEnum):
    LR_NORMAL_CENTRAL = 0
    LR_NORMAL_ANALYTIC = 1
    LR_NORMAL_SMOOTH = 2
    LR_NORMAL_SOBEL = 3
    LR_NORMAL_ZUCKER_HUMMEL = 4


class lr_projection(IntEnum):
    LR_PERSPECTIVE = 0
    LR_ORTHOGRAPHIC = 1


class lr_visibility(IntEnum):
    LR_VISIBLE_CAMERA = 1
    LR_VISIBLE_SHADOW = 2
    LR_VISIBLE_DIFFUSE = 4
    LR_VISIBLE_GLOSSY = 8
    LR_VISIBLE_TRANSMISSION = 16
    LR_VISIBLE_VOLUME_SCATTER = 32


class lr_light_kind(IntEnum):
    LR_LIGHT_SUN = 0
    LR_LIGHT_POINT = 1
    LR_LIGHT_SPOT = 2
    LR_LIGHT_AREA = 3


class lr_light_shape(IntEnum):
    LR_LIGHT_ROUND = 0
    LR_LIGHT_FULL = 1


class lr_lobe_kind(IntEnum):
    LR_LOBE_DIFFUSE = 0
    LR_LOBE_GLOSSY = 1
    LR_LOBE_GLASS = 2
    LR_LOBE_REFRACTION = 3
    LR_LOBE_TRANSPARENT = 4
    LR_LOBE_EMISSION = 5
    LR_LOBE_PRINCIPLED = 6


class lr_lobe_flag(IntEnum):
    LR_LOBE_TEXTURED = 1
    LR_LOBE_MULTISCATTER = 2


class lr_phase_kind(IntEnum):
    LR_PHASE_HENYEY_GREENSTEIN = 0
    LR_PHASE_RAYLEIGH = 1


class lr_field_part(IntEnum):
    LR_FIELD_VALUE = 0
    LR_FIELD_SLOPE = 1
    LR_FIELD_ID = 2


class lr_film_filter(IntEnum):
    LR_FILM_BOX = 0
    LR_FILM_BLACKMAN_HARRIS = 1


class lr_ray_kind(IntEnum):
    LR_RAY_CAMERA = 0
    LR_RAY_DIFFUSE = 1
    LR_RAY_GLOSSY = 2
    LR_RAY_TRANSMISSION = 3
    LR_RAY_TRANSPARENT = 4
    LR_RAY_VOLUME = 5


class lr_event_kind(IntEnum):
    LR_EVENT_RAY = 0
    LR_EVENT_HIT = 1
    LR_EVENT_LIGHT = 2
    LR_EVENT_FOUND = 3
    LR_EVENT_SCATTER = 4


class lr_image_flag(IntEnum):
    LR_IMAGE_EXACT = 1
    LR_IMAGE_PERSPECTIVE = 2
    LR_IMAGE_SURFACES = 4
    LR_IMAGE_LIGHTS = 8
    LR_IMAGE_FRAMES = 16


class lr_pixel(IntEnum):
    LR_PIXEL_MISS = 0
    LR_PIXEL_HIT = 1
    LR_PIXEL_SKIPPED = 2


LR_OK, LR_E_ARGUMENT, LR_E_SIZE, LR_E_MEMORY, LR_E_STOPPED = lr_status
LR_U8, LR_U16, LR_F32 = lr_sample_type
LR_KIND_AUTO, LR_KIND_SOLID, LR_KIND_SHEET = lr_kind
LR_VOLUME_LINEAR, LR_VOLUME_CUBIC = lr_volume_interpolation
LR_NUMBER_U8, LR_NUMBER_I8, LR_NUMBER_U16, LR_NUMBER_I16, LR_NUMBER_U32, LR_NUMBER_I32, LR_NUMBER_F32, LR_NUMBER_F64 = lr_number_type
LR_OP_ADD, LR_OP_SUBTRACT, LR_OP_MULTIPLY, LR_OP_DIVIDE, LR_OP_MULTIPLY_ADD, LR_OP_POWER, LR_OP_LOGARITHM, LR_OP_SQRT, LR_OP_INVERSE_SQRT, LR_OP_ABSOLUTE, LR_OP_EXPONENT, LR_OP_MINIMUM, LR_OP_MAXIMUM, LR_OP_LESS_THAN, LR_OP_GREATER_THAN, LR_OP_COMPARE, LR_OP_SIGN, LR_OP_SMOOTH_MIN, LR_OP_ROUND, LR_OP_FLOOR, LR_OP_CEIL, LR_OP_TRUNC, LR_OP_FRACT, LR_OP_MODULO, LR_OP_FLOORED_MODULO, LR_OP_WRAP, LR_OP_PINGPONG, LR_OP_SINE, LR_OP_COSINE, LR_OP_TANGENT, LR_OP_ARCSINE, LR_OP_ARCCOSINE, LR_OP_ARCTANGENT, LR_OP_ARCTAN2, LR_OP_SINH, LR_OP_COSH, LR_OP_TANH, LR_OP_SELECT, LR_OP_FROM_SRGB, LR_OP_TABLE = lr_operation
LR_TABLE_LINEAR, LR_TABLE_CONSTANT, LR_TABLE_EXTRAPOLATE = lr_table_kind
LR_INTERPOLATION_LINEAR, LR_INTERPOLATION_CLOSEST, LR_INTERPOLATION_CUBIC = lr_interpolation
LR_EXTENSION_REPEAT, LR_EXTENSION_EXTEND, LR_EXTENSION_CLIP, LR_EXTENSION_MIRROR = lr_extension
LR_COLOR_NONE, LR_COLOR_VERTEX = lr_color_source
LR_FILTER_RAMP, LR_FILTER_BOX, LR_FILTER_CONE, LR_FILTER_GAUSS, LR_FILTER_BINARY = lr_filter
LR_SIMD_AUTO, LR_SIMD_PORTABLE, LR_SIMD_AVX2, LR_SIMD_AVX512 = lr_simd
LR_EXACT_SHEETS, LR_EXACT_ALL, LR_EXACT_NONE, LR_EXACT_EVERY = lr_exact_cells
LR_STAGE_NONE, LR_STAGE_SET_UP, LR_STAGE_COMPONENTS, LR_STAGE_WINDING, LR_STAGE_BRICKS, LR_STAGE_CELLS, LR_STAGE_DONE = lr_stage
LR_REASON_ASKED, LR_REASON_CLOSED, LR_REASON_CROSSING, LR_REASON_ENCLOSES, LR_REASON_HOLES, LR_REASON_FLIPPED, LR_REASON_EMPTY = lr_reason
LR_METRIC_CHESSBOARD, LR_METRIC_CITYBLOCK, LR_METRIC_CHAMFER345, LR_METRIC_EUCLID = lr_metric
LR_TRAVERSER_EXACT, LR_TRAVERSER_DEFAULT, LR_TRAVERSER_RECTILINEAR, LR_TRAVERSER_TRIAL = lr_traverser_flag
LR_MODE_SURFACE, LR_MODE_BINARY, LR_MODE_VOLUME, LR_MODE_MAXIMUM, LR_MODE_MINIMUM, LR_MODE_MEAN = lr_mode
LR_SAMPLING_EXACT, LR_SAMPLING_POST, LR_SAMPLING_PRE = lr_sampling
LR_HIT_EXTREMA, LR_HIT_FACES, LR_HIT_UNIFORM = lr_hit_test
LR_ROOT_NEWTON, LR_ROOT_BISECT, LR_ROOT_CUBIC, LR_ROOT_LINEAR = lr_root
LR_NORMAL_CENTRAL, LR_NORMAL_ANALYTIC, LR_NORMAL_SMOOTH, LR_NORMAL_SOBEL, LR_NORMAL_ZUCKER_HUMMEL = lr_normal
LR_PERSPECTIVE, LR_ORTHOGRAPHIC = lr_projection
LR_VISIBLE_CAMERA, LR_VISIBLE_SHADOW, LR_VISIBLE_DIFFUSE, LR_VISIBLE_GLOSSY, LR_VISIBLE_TRANSMISSION, LR_VISIBLE_VOLUME_SCATTER = lr_visibility
LR_LIGHT_SUN, LR_LIGHT_POINT, LR_LIGHT_SPOT, LR_LIGHT_AREA = lr_light_kind
LR_LIGHT_ROUND, LR_LIGHT_FULL = lr_light_shape
LR_LOBE_DIFFUSE, LR_LOBE_GLOSSY, LR_LOBE_GLASS, LR_LOBE_REFRACTION, LR_LOBE_TRANSPARENT, LR_LOBE_EMISSION, LR_LOBE_PRINCIPLED = lr_lobe_kind
LR_LOBE_TEXTURED, LR_LOBE_MULTISCATTER = lr_lobe_flag
LR_PHASE_HENYEY_GREENSTEIN, LR_PHASE_RAYLEIGH = lr_phase_kind
LR_FIELD_VALUE, LR_FIELD_SLOPE, LR_FIELD_ID = lr_field_part
LR_FILM_BOX, LR_FILM_BLACKMAN_HARRIS = lr_film_filter
LR_RAY_CAMERA, LR_RAY_DIFFUSE, LR_RAY_GLOSSY, LR_RAY_TRANSMISSION, LR_RAY_TRANSPARENT, LR_RAY_VOLUME = lr_ray_kind
LR_EVENT_RAY, LR_EVENT_HIT, LR_EVENT_LIGHT, LR_EVENT_FOUND, LR_EVENT_SCATTER = lr_event_kind
LR_IMAGE_EXACT, LR_IMAGE_PERSPECTIVE, LR_IMAGE_SURFACES, LR_IMAGE_LIGHTS, LR_IMAGE_FRAMES = lr_image_flag
LR_PIXEL_MISS, LR_PIXEL_HIT, LR_PIXEL_SKIPPED = lr_pixel


class lr_error(ctypes.Structure):
    _fields_ = (
        ("text", ctypes.c_char * 480),
    )


class lr_watch(ctypes.Structure):
    _fields_ = (
        ("stop", ctypes.POINTER(ctypes.c_int32)),
        ("progress", ctypes.POINTER(ctypes.c_double)),
    )


class lr_volume(ctypes.Structure):
    pass  # opaque


class lr_volume_desc(ctypes.Structure):
    _fields_ = (
        ("nx", ctypes.c_int32),
        ("ny", ctypes.c_int32),
        ("nz", ctypes.c_int32),
        ("sample_type", ctypes.c_int32),
        ("kind", ctypes.c_int32),
        ("has_ids", ctypes.c_int32),
        ("interpolation", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
        ("threshold", ctypes.c_double),
        ("object_from_index", ctypes.c_double * 16),
        ("outside", ctypes.c_double),
        ("inside", ctypes.c_double),
    )


class lr_volume_info(ctypes.Structure):
    _fields_ = (
        ("desc", lr_volume_desc),
        ("n_bricks", ctypes.c_uint64),
        ("n_full", ctypes.c_uint64),
        ("n_surface_cells", ctypes.c_uint64),
        ("n_triangle_cells", ctypes.c_uint64),
        ("n_cell_triangles", ctypes.c_uint64),
        ("nbytes", ctypes.c_uint64),
        ("triangle_cells_nbytes", ctypes.c_uint64),
        ("has_colors", ctypes.c_int32),
        ("has_normals", ctypes.c_int32),
        ("n_objects", ctypes.c_uint64),
        ("n_shared", ctypes.c_uint64),
        ("n_dropped", ctypes.c_uint64),
        ("surface_lo", ctypes.c_int32 * 3),
        ("surface_hi", ctypes.c_int32 * 3),
    )


class lr_samples(ctypes.Structure):
    pass  # opaque


class lr_samples_desc(ctypes.Structure):
    _fields_ = (
        ("nx", ctypes.c_int32),
        ("ny", ctypes.c_int32),
        ("nz", ctypes.c_int32),
        ("number_type", ctypes.c_int32),
        ("open", ctypes.c_int32),
        ("has_no_data", ctypes.c_int32),
        ("interpolation", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
        ("no_data", ctypes.c_double),
        ("object_from_index", ctypes.c_double * 16),
    )


class lr_samples_range(ctypes.Structure):
    _fields_ = (
        ("low", ctypes.c_double),
        ("high", ctypes.c_double),
        ("has_none", ctypes.c_int32),
        ("fits_floats", ctypes.c_int32),
    )


class lr_samples_map(ctypes.Structure):
    _fields_ = (
        ("sample_type", ctypes.c_int32),
        ("rounded", ctypes.c_int32),
        ("gain", ctypes.c_double),
        ("base", ctypes.c_double),
        ("outside", ctypes.c_double),
        ("inside", ctypes.c_double),
        ("threshold", ctypes.c_double),
    )


class lr_transfer_desc(ctypes.Structure):
    _fields_ = (
        ("n", ctypes.c_uint64),
        ("values", ctypes.POINTER(ctypes.c_double)),
        ("extinction", ctypes.POINTER(ctypes.c_double)),
        ("colors", ctypes.POINTER(ctypes.c_double)),
        ("emission", ctypes.POINTER(ctypes.c_double)),
        ("scattering", ctypes.POINTER(ctypes.c_double)),
        ("full_gradient", ctypes.c_double),
    )


class lr_transfer(ctypes.Structure):
    pass  # opaque


class lr_table(ctypes.Structure):
    _fields_ = (
        ("first", ctypes.c_uint32),
        ("n", ctypes.c_uint32),
        ("kind", ctypes.c_int32),
    )


class lr_instruction(ctypes.Structure):
    _fields_ = (
        ("operation", ctypes.c_uint16),
        ("to", ctypes.c_uint16),
        ("a", ctypes.c_uint16),
        ("b", ctypes.c_uint16),
        ("c", ctypes.c_uint16),
    )


class lr_program(ctypes.Structure):
    _fields_ = (
        ("instructions", ctypes.POINTER(lr_instruction)),
        ("n_instructions", ctypes.c_uint64),
        ("constants", ctypes.POINTER(ctypes.c_float)),
        ("n_constants", ctypes.c_uint64),
        ("tables", ctypes.POINTER(lr_table)),
        ("n_tables", ctypes.c_uint64),
        ("values", ctypes.POINTER(ctypes.c_float)),
        ("n_values", ctypes.c_uint64),
        ("outputs", ctypes.c_uint16 * 3),
        ("reserved", ctypes.c_uint16),
    )


class lr_texture(ctypes.Structure):
    pass  # opaque


class lr_texture_desc(ctypes.Structure):
    _fields_ = (
        ("pixels", ctypes.c_void_p),
        ("program", ctypes.POINTER(lr_program)),
        ("sample_type", ctypes.c_int32),
        ("channels", ctypes.c_int32),
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("interpolation", ctypes.c_int32),
        ("extension", ctypes.c_int32),
        ("points_only", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
    )


class lr_attributes(ctypes.Structure):
    _fields_ = (
        ("corner_normals", ctypes.POINTER(ctypes.c_float)),
        ("corner_colors", ctypes.POINTER(ctypes.c_float)),
        ("corner_uvs", ctypes.POINTER(ctypes.c_float)),
        ("color_sources", ctypes.POINTER(ctypes.c_int32)),
        ("textures", ctypes.POINTER(ctypes.POINTER(lr_texture))),
        ("n_textures", ctypes.c_uint64),
    )


class lr_mesh(ctypes.Structure):
    _fields_ = (
        ("vertices", ctypes.POINTER(ctypes.c_double)),
        ("n_vertices", ctypes.c_uint64),
        ("triangles", ctypes.POINTER(ctypes.c_int32)),
        ("n_triangles", ctypes.c_uint64),
        ("ids", ctypes.POINTER(ctypes.c_uint16)),
        ("attributes", ctypes.POINTER(lr_attributes)),
    )


class lr_filter_info(ctypes.Structure):
    _fields_ = (
        ("half_width", ctypes.c_double),
        ("widest", ctypes.c_double),
        ("of_solids", ctypes.c_int32),
    )


class lr_voxelize_options(ctypes.Structure):
    _fields_ = (
        ("voxel_size", ctypes.c_double),
        ("half_width", ctypes.c_double),
        ("filter", ctypes.c_int32),
        ("kind", ctypes.c_int32),
        ("sample_type", ctypes.c_int32),
        ("simd", ctypes.c_int32),
        ("exact", ctypes.c_int32),
        ("flat", ctypes.c_int32),
    )


class lr_voxelizer(ctypes.Structure):
    pass  # opaque


class lr_voxelizer_info(ctypes.Structure):
    _fields_ = (
        ("desc", lr_volume_desc),
        ("stage", ctypes.c_int32),
        ("nbytes", ctypes.c_uint64),
        ("n_border_edges", ctypes.c_uint64),
        ("n_bad_edges", ctypes.c_uint64),
        ("n_degenerate", ctypes.c_uint64),
        ("inverted", ctypes.c_int32),
        ("simd", ctypes.c_int32),
        ("reason", ctypes.c_int32),
        ("by_winding", ctypes.c_int32),
        ("hole", ctypes.c_double),
        ("scratch_nbytes", ctypes.c_uint64),
    )


class lr_traverser(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("label", ctypes.c_char_p),
        ("source", ctypes.c_char_p),
        ("about", ctypes.c_char_p),
        ("options", ctypes.c_char_p),
        ("flags", ctypes.c_uint32),
    )


class lr_structure(ctypes.Structure):
    pass  # opaque


class lr_phong(ctypes.Structure):
    _fields_ = (
        ("ambient", ctypes.c_double),
        ("diffuse", ctypes.c_double),
        ("specular", ctypes.c_double),
        ("light", ctypes.c_double * 3),
        ("power", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
    )


class lr_trace_options(ctypes.Structure):
    _fields_ = (
        ("mode", ctypes.c_int32),
        ("hit_test", ctypes.c_int32),
        ("root", ctypes.c_int32),
        ("normal", ctypes.c_int32),
        ("step", ctypes.c_double),
        ("sampling", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
        ("tolerance", ctypes.c_double),
        ("stop_opacity", ctypes.c_double),
        ("phong", ctypes.POINTER(lr_phong)),
    )


class lr_start(ctypes.Structure):
    _fields_ = (
        ("cell", ctypes.c_int32 * 3),
        ("side", ctypes.c_int32),
    )


class lr_rays(ctypes.Structure):
    _fields_ = (
        ("ox", ctypes.POINTER(ctypes.c_double)),
        ("oy", ctypes.POINTER(ctypes.c_double)),
        ("oz", ctypes.POINTER(ctypes.c_double)),
        ("dx", ctypes.POINTER(ctypes.c_double)),
        ("dy", ctypes.POINTER(ctypes.c_double)),
        ("dz", ctypes.POINTER(ctypes.c_double)),
        ("t_min", ctypes.POINTER(ctypes.c_double)),
        ("t_max", ctypes.POINTER(ctypes.c_double)),
        ("start", ctypes.POINTER(lr_start)),
        ("way", ctypes.POINTER(ctypes.c_double * 3)),
        ("length", ctypes.POINTER(ctypes.c_double)),
        ("stop", ctypes.POINTER(ctypes.c_double)),
    )


class lr_hits(ctypes.Structure):
    _fields_ = (
        ("t", ctypes.POINTER(ctypes.c_double)),
        ("ci", ctypes.POINTER(ctypes.c_int32)),
        ("cj", ctypes.POINTER(ctypes.c_int32)),
        ("ck", ctypes.POINTER(ctypes.c_int32)),
        ("nx", ctypes.POINTER(ctypes.c_double)),
        ("ny", ctypes.POINTER(ctypes.c_double)),
        ("nz", ctypes.POINTER(ctypes.c_double)),
        ("gx", ctypes.POINTER(ctypes.c_double)),
        ("gy", ctypes.POINTER(ctypes.c_double)),
        ("gz", ctypes.POINTER(ctypes.c_double)),
        ("id", ctypes.POINTER(ctypes.c_int32)),
        ("triangle", ctypes.POINTER(ctypes.c_uint32)),
        ("steps", ctypes.POINTER(ctypes.c_int32)),
        ("red", ctypes.POINTER(ctypes.c_double)),
        ("green", ctypes.POINTER(ctypes.c_double)),
        ("blue", ctypes.POINTER(ctypes.c_double)),
        ("transmittance", ctypes.POINTER(ctypes.c_double)),
        ("value", ctypes.POINTER(ctypes.c_double)),
        ("length", ctypes.POINTER(ctypes.c_double)),
    )


class lr_counters(ctypes.Structure):
    _fields_ = (
        ("rays", ctypes.c_uint64),
        ("cells", ctypes.c_uint64),
        ("jumps", ctypes.c_uint64),
        ("nodes", ctypes.c_uint64),
        ("tests", ctypes.c_uint64),
        ("samples", ctypes.c_uint64),
        ("hits", ctypes.c_uint64),
        ("most_cells", ctypes.c_uint64),
        ("forgotten", ctypes.c_uint64),
        ("pairs", ctypes.c_uint64),
        ("in_lanes", ctypes.c_uint64),
    )


class lr_camera(ctypes.Structure):
    _fields_ = (
        ("projection", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
        ("eye", ctypes.c_double * 3),
        ("forward", ctypes.c_double * 3),
        ("corner", ctypes.c_double * 3),
        ("dx", ctypes.c_double * 3),
        ("dy", ctypes.c_double * 3),
        ("clip_start", ctypes.c_double),
        ("clip_end", ctypes.c_double),
    )


class lr_light(ctypes.Structure):
    _fields_ = (
        ("kind", ctypes.c_int32),
        ("shape", ctypes.c_int32),
        ("visibility", ctypes.c_uint32),
        ("max_bounces", ctypes.c_int32),
        ("position", ctypes.c_double * 3),
        ("direction", ctypes.c_double * 3),
        ("axis_u", ctypes.c_double * 3),
        ("axis_v", ctypes.c_double * 3),
        ("color", ctypes.c_double * 3),
        ("radius", ctypes.c_double),
        ("angle", ctypes.c_double),
        ("blend", ctypes.c_double),
        ("plane_margin", ctypes.c_double),
    )


class lr_lobe(ctypes.Structure):
    _fields_ = (
        ("kind", ctypes.c_int32),
        ("flags", ctypes.c_uint32),
        ("weight", ctypes.c_double),
        ("color", ctypes.c_double * 3),
        ("roughness", ctypes.c_double),
        ("ior", ctypes.c_double),
        ("metallic", ctypes.c_double),
        ("specular", ctypes.c_double),
        ("specular_tint", ctypes.c_double * 3),
        ("transmission", ctypes.c_double),
        ("alpha", ctypes.c_double),
        ("emission", ctypes.c_double * 3),
    )


class lr_material_desc(ctypes.Structure):
    _fields_ = (
        ("lobes", ctypes.POINTER(lr_lobe)),
        ("n_lobes", ctypes.c_uint32),
        ("index", ctypes.c_int32),
        ("absorption", ctypes.c_double * 3),
        ("scattering", ctypes.c_double * 3),
        ("glow", ctypes.c_double * 3),
        ("anisotropy", ctypes.c_double),
        ("phase", ctypes.c_int32),
        ("bare", ctypes.c_int32),
    )


class lr_world(ctypes.Structure):
    _fields_ = (
        ("color", ctypes.c_double * 3),
        ("image_from_world", ctypes.c_double * 9),
        ("image", ctypes.POINTER(lr_texture)),
        ("visibility", ctypes.c_uint32),
        ("max_bounces", ctypes.c_int32),
    )


class lr_clip(ctypes.Structure):
    _fields_ = (
        ("volume", ctypes.POINTER(lr_volume)),
        ("world_from_object", ctypes.c_double * 16),
        ("margin", ctypes.c_double),
        ("inside", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
    )


class lr_field_color(ctypes.Structure):
    _fields_ = (
        ("volume", ctypes.POINTER(lr_volume)),
        ("world_from_object", ctypes.c_double * 16),
        ("program", ctypes.POINTER(lr_program)),
        ("scale", ctypes.c_double),
        ("offset", ctypes.c_double),
        ("part", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
    )


class lr_instance(ctypes.Structure):
    _fields_ = (
        ("structure", ctypes.POINTER(lr_structure)),
        ("world_from_object", ctypes.c_double * 16),
        ("visibility", ctypes.c_uint32),
        ("object_index", ctypes.c_int32),
        ("first_material", ctypes.c_uint32),
        ("n_materials", ctypes.c_uint32),
        ("volume_index", ctypes.c_int32),
        ("holdout", ctypes.c_int32),
        ("error", ctypes.c_double),
        ("clips", ctypes.POINTER(lr_clip)),
        ("n_clips", ctypes.c_uint64),
        ("field_color", ctypes.POINTER(lr_field_color)),
        ("volume_unit", ctypes.c_double),
        ("anisotropy", ctypes.c_double),
        ("gradient_shading", ctypes.c_double),
        ("gradient_scale", ctypes.c_double),
        ("roughness", ctypes.c_double),
        ("specular", ctypes.c_double),
        ("phase", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
    )


class lr_scene_desc(ctypes.Structure):
    _fields_ = (
        ("camera", lr_camera),
        ("instances", ctypes.POINTER(lr_instance)),
        ("n_instances", ctypes.c_uint64),
        ("lights", ctypes.POINTER(lr_light)),
        ("n_lights", ctypes.c_uint64),
        ("materials", ctypes.POINTER(lr_material_desc)),
        ("n_materials", ctypes.c_uint64),
        ("slots", ctypes.POINTER(ctypes.c_uint32)),
        ("slot_objects", ctypes.POINTER(ctypes.c_int32)),
        ("n_slots", ctypes.c_uint64),
        ("world", lr_world),
        ("mist_start", ctypes.c_double),
        ("mist_depth", ctypes.c_double),
        ("mist_power", ctypes.c_double),
        ("film_transparent", ctypes.c_int32),
        ("lone_media", ctypes.c_int32),
    )


class lr_scene(ctypes.Structure):
    pass  # opaque


class lr_event(ctypes.Structure):
    _fields_ = (
        ("kind", ctypes.c_int32),
        ("sample", ctypes.c_uint32),
        ("ray", ctypes.c_uint32),
        ("parent", ctypes.c_uint32),
        ("ray_kind", ctypes.c_int32),
        ("bounces", ctypes.c_int32),
        ("transparent", ctypes.c_int32),
        ("last", ctypes.c_int32),
        ("instance", ctypes.c_uint32),
        ("material", ctypes.c_uint32),
        ("id", ctypes.c_int32),
        ("triangle", ctypes.c_uint32),
        ("cell", ctypes.c_int32 * 3),
        ("side", ctypes.c_int32),
        ("steps", ctypes.c_int32),
        ("n_media", ctypes.c_uint32),
        ("media", ctypes.c_uint32 * 6),
        ("media_material", ctypes.c_uint32 * 6),
        ("light", ctypes.c_uint64),
        ("origin", ctypes.c_double * 3),
        ("direction", ctypes.c_double * 3),
        ("t", ctypes.c_double),
        ("throughput", ctypes.c_double * 3),
        ("position", ctypes.c_double * 3),
        ("normal", ctypes.c_double * 3),
        ("probability", ctypes.c_double),
        ("pdf", ctypes.c_double),
        ("weight", ctypes.c_double),
        ("contribution", ctypes.c_double * 3),
    )


class lr_record(ctypes.Structure):
    _fields_ = (
        ("events", ctypes.POINTER(lr_event)),
        ("capacity", ctypes.c_uint64),
        ("n", ctypes.c_uint64),
        ("samples", ctypes.c_uint64),
    )


class lr_tile(ctypes.Structure):
    _fields_ = (
        ("x", ctypes.c_int32),
        ("y", ctypes.c_int32),
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("samples", ctypes.c_int32),
        ("min_samples", ctypes.c_int32),
        ("noise_threshold", ctypes.c_double),
        ("filter", ctypes.c_int32),
        ("seed", ctypes.c_uint32),
        ("filter_width", ctypes.c_double),
        ("max_bounces", ctypes.c_int32),
        ("diffuse_bounces", ctypes.c_int32),
        ("glossy_bounces", ctypes.c_int32),
        ("transmission_bounces", ctypes.c_int32),
        ("transparent_bounces", ctypes.c_int32),
        ("volume_bounces", ctypes.c_int32),
        ("branches", ctypes.c_int32),
        ("ao_distance", ctypes.c_double),
        ("ambient_distance", ctypes.c_double),
        ("clamp_direct", ctypes.c_double),
        ("clamp_indirect", ctypes.c_double),
        ("trace", lr_trace_options),
        ("record", ctypes.POINTER(lr_record)),
    )


class lr_passes(ctypes.Structure):
    _fields_ = (
        ("combined", ctypes.POINTER(ctypes.c_float)),
        ("depth", ctypes.POINTER(ctypes.c_float)),
        ("normal", ctypes.POINTER(ctypes.c_float)),
        ("position", ctypes.POINTER(ctypes.c_float)),
        ("object_index", ctypes.POINTER(ctypes.c_float)),
        ("material_index", ctypes.POINTER(ctypes.c_float)),
        ("mist", ctypes.POINTER(ctypes.c_float)),
        ("ao", ctypes.POINTER(ctypes.c_float)),
        ("emission", ctypes.POINTER(ctypes.c_float)),
        ("environment", ctypes.POINTER(ctypes.c_float)),
        ("error", ctypes.POINTER(ctypes.c_float)),
        ("volume", ctypes.POINTER(ctypes.c_float)),
        ("steps", ctypes.POINTER(ctypes.c_float)),
    )


class lr_image_method(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("label", ctypes.c_char_p),
        ("source", ctypes.c_char_p),
        ("about", ctypes.c_char_p),
        ("options", ctypes.c_char_p),
        ("flags", ctypes.c_uint32),
    )


class lr_prepared(ctypes.Structure):
    pass  # opaque


class lr_image_light(ctypes.Structure):
    _fields_ = (
        ("place", ctypes.c_double * 3),
        ("color", ctypes.c_double * 3),
        ("distant", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
    )


class lr_image(ctypes.Structure):
    _fields_ = (
        ("x", ctypes.c_int32),
        ("y", ctypes.c_int32),
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("t", ctypes.POINTER(ctypes.c_double)),
        ("cell", ctypes.POINTER(ctypes.c_int32)),
        ("pixel", ctypes.POINTER(ctypes.c_uint8)),
        ("shade", ctypes.POINTER(ctypes.c_double)),
        ("normal", ctypes.POINTER(ctypes.c_double)),
        ("empty", ctypes.POINTER(ctypes.c_double)),
    )


class lr_frame_before(ctypes.Structure):
    _fields_ = (
        ("camera", lr_camera),
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("empty", ctypes.POINTER(ctypes.c_double)),
    )


PROTOTYPES = {
    "lr_abi": (ctypes.c_int32, ()),
    "lr_version": (ctypes.c_char_p, ()),
    "lr_volume_begin": (ctypes.c_int, (
        ctypes.POINTER(lr_volume_desc),
        ctypes.POINTER(ctypes.POINTER(lr_volume)),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_put": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.c_void_p,
        ctypes.POINTER(ctypes.c_uint16),
        ctypes.POINTER(ctypes.c_uint8),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_set_planes": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_finish": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_free": (None, (
        ctypes.POINTER(lr_volume),
    )),
    "lr_volume_get_info": (None, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(lr_volume_info),
    )),
    "lr_volume_get": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.c_void_p,
        ctypes.POINTER(ctypes.c_uint16),
        ctypes.POINTER(ctypes.c_uint8),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_get_bricks": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.c_uint64,
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_packed_nbytes": (ctypes.c_uint64, (
        ctypes.POINTER(lr_volume),
    )),
    "lr_volume_pack": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(ctypes.c_uint8),
        ctypes.c_uint64,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_unpack": (ctypes.c_int, (
        ctypes.POINTER(ctypes.c_uint8),
        ctypes.c_uint64,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(ctypes.POINTER(lr_volume)),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_sample": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_uint16),
        ctypes.c_uint64,
        ctypes.c_double,
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_narrow": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.c_double,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_attributes": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_uint16),
        ctypes.c_uint64,
        ctypes.c_double,
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_normals": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_uint16),
        ctypes.c_uint64,
        ctypes.c_int32,
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_merge": (ctypes.c_int, (
        ctypes.POINTER(ctypes.POINTER(lr_volume)),
        ctypes.c_uint64,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(ctypes.POINTER(lr_volume)),
        ctypes.POINTER(lr_error),
    )),
    "lr_samples_begin": (ctypes.c_int, (
        ctypes.POINTER(lr_samples_desc),
        ctypes.POINTER(ctypes.POINTER(lr_samples)),
        ctypes.POINTER(lr_error),
    )),
    "lr_samples_free": (None, (
        ctypes.POINTER(lr_samples),
    )),
    "lr_samples_part": (ctypes.c_int, (
        ctypes.POINTER(lr_samples),
        ctypes.c_int32,
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(lr_error),
    )),
    "lr_samples_scan": (ctypes.c_int, (
        ctypes.POINTER(lr_samples),
        ctypes.c_int32,
        ctypes.c_void_p,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_samples_scan_leaves": (ctypes.c_int, (
        ctypes.POINTER(lr_samples),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.c_void_p,
        ctypes.c_uint64,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_samples_put_tiles": (ctypes.c_int, (
        ctypes.POINTER(lr_samples),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(ctypes.c_double),
        ctypes.c_uint64,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_samples_get_range": (None, (
        ctypes.POINTER(lr_samples),
        ctypes.POINTER(lr_samples_range),
    )),
    "lr_samples_allocate": (ctypes.c_int, (
        ctypes.POINTER(lr_samples),
        ctypes.POINTER(lr_samples_map),
        ctypes.c_uint64,
        ctypes.POINTER(ctypes.c_uint64),
        ctypes.POINTER(lr_error),
    )),
    "lr_samples_fill": (ctypes.c_int, (
        ctypes.POINTER(lr_samples),
        ctypes.c_int32,
        ctypes.c_void_p,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_samples_fill_leaves": (ctypes.c_int, (
        ctypes.POINTER(lr_samples),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.c_void_p,
        ctypes.c_uint64,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_isosurface_begin": (ctypes.c_int, (
        ctypes.POINTER(lr_samples),
        ctypes.c_double,
        ctypes.POINTER(ctypes.POINTER(lr_volume)),
        ctypes.POINTER(lr_error),
    )),
    "lr_isosurface_part": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.c_int32,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_isosurface_finish": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(lr_error),
    )),
    "lr_transfer_new": (ctypes.c_int, (
        ctypes.POINTER(lr_transfer_desc),
        ctypes.POINTER(ctypes.POINTER(lr_transfer)),
        ctypes.POINTER(lr_error),
    )),
    "lr_transfer_free": (None, (
        ctypes.POINTER(lr_transfer),
    )),
    "lr_transfer_greatest": (ctypes.c_int, (
        ctypes.POINTER(lr_transfer),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_double),
        ctypes.c_uint64,
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(lr_error),
    )),
    "lr_samples_hide": (ctypes.c_int, (
        ctypes.POINTER(lr_samples),
        ctypes.POINTER(lr_transfer),
        ctypes.c_double,
        ctypes.c_double,
        ctypes.POINTER(lr_error),
    )),
    "lr_visible_begin": (ctypes.c_int, (
        ctypes.POINTER(lr_samples),
        ctypes.POINTER(lr_transfer),
        ctypes.c_double,
        ctypes.c_double,
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.POINTER(ctypes.POINTER(lr_volume)),
        ctypes.POINTER(lr_error),
    )),
    "lr_small_components": (ctypes.c_int, (
        ctypes.POINTER(ctypes.c_uint8),
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_uint64,
        ctypes.POINTER(ctypes.c_uint8),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_operate": (ctypes.c_float, (
        ctypes.c_int32,
        ctypes.c_float,
        ctypes.c_float,
        ctypes.c_float,
    )),
    "lr_program_run": (ctypes.c_int, (
        ctypes.POINTER(lr_program),
        ctypes.POINTER(ctypes.c_float),
        ctypes.c_uint64,
        ctypes.POINTER(ctypes.c_float),
        ctypes.POINTER(lr_error),
    )),
    "lr_texture_new": (ctypes.c_int, (
        ctypes.POINTER(lr_texture_desc),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(ctypes.POINTER(lr_texture)),
        ctypes.POINTER(lr_error),
    )),
    "lr_texture_free": (None, (
        ctypes.POINTER(lr_texture),
    )),
    "lr_texture_nbytes": (ctypes.c_uint64, (
        ctypes.POINTER(lr_texture),
    )),
    "lr_texture_sample": (ctypes.c_int, (
        ctypes.POINTER(lr_texture),
        ctypes.POINTER(ctypes.c_float),
        ctypes.POINTER(ctypes.c_float),
        ctypes.c_uint64,
        ctypes.POINTER(ctypes.c_float),
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_bind": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(ctypes.POINTER(lr_texture)),
        ctypes.c_uint64,
        ctypes.POINTER(lr_error),
    )),
    "lr_volume_exact_at": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.POINTER(ctypes.c_double),
        ctypes.c_uint64,
        ctypes.POINTER(ctypes.c_uint8),
        ctypes.POINTER(lr_error),
    )),
    "lr_filter_get": (ctypes.c_int, (
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.POINTER(lr_filter_info),
        ctypes.POINTER(lr_error),
    )),
    "lr_filter_slope": (ctypes.c_double, (
        ctypes.c_int32,
        ctypes.c_double,
    )),
    "lr_voxelize_begin": (ctypes.c_int, (
        ctypes.POINTER(lr_mesh),
        ctypes.POINTER(lr_voxelize_options),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(ctypes.POINTER(lr_voxelizer)),
        ctypes.POINTER(lr_error),
    )),
    "lr_voxelizer_get_info": (None, (
        ctypes.POINTER(lr_voxelizer),
        ctypes.POINTER(lr_voxelizer_info),
    )),
    "lr_voxelize_next": (ctypes.c_int, (
        ctypes.POINTER(lr_voxelizer),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(ctypes.c_uint64),
        ctypes.POINTER(lr_error),
    )),
    "lr_voxelize_part": (ctypes.c_int, (
        ctypes.POINTER(lr_voxelizer),
        ctypes.c_uint64,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_voxelize_end": (ctypes.c_int, (
        ctypes.POINTER(lr_voxelizer),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(ctypes.POINTER(lr_volume)),
        ctypes.POINTER(lr_error),
    )),
    "lr_voxelizer_free": (None, (
        ctypes.POINTER(lr_voxelizer),
    )),
    "lr_mesh_layers": (ctypes.c_int, (
        ctypes.POINTER(lr_mesh),
        ctypes.c_double,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(lr_error),
    )),
    "lr_mesh_scratch_nbytes": (ctypes.c_uint64, (
        ctypes.c_uint64,
        ctypes.c_uint64,
    )),
    "lr_mesh_edges": (ctypes.c_int, (
        ctypes.POINTER(lr_mesh),
        ctypes.c_int32,
        ctypes.c_double,
        ctypes.c_double,
        ctypes.POINTER(ctypes.c_uint32),
        ctypes.c_uint64,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(ctypes.c_uint64),
        ctypes.POINTER(ctypes.c_uint64),
        ctypes.POINTER(lr_error),
    )),
    "lr_distance": (ctypes.c_int, (
        ctypes.POINTER(ctypes.c_uint8),
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_void_p,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_distance_parts": (ctypes.c_int, (
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(ctypes.c_int64),
        ctypes.POINTER(lr_error),
    )),
    "lr_distance_part": (ctypes.c_int, (
        ctypes.POINTER(ctypes.c_uint8),
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int64,
        ctypes.c_void_p,
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_traverser_count": (ctypes.c_int32, ()),
    "lr_traverser_get": (ctypes.c_int, (
        ctypes.c_int32,
        ctypes.POINTER(lr_traverser),
        ctypes.POINTER(lr_error),
    )),
    "lr_structure_build": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.c_int32,
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(ctypes.POINTER(lr_structure)),
        ctypes.POINTER(lr_error),
    )),
    "lr_structure_free": (None, (
        ctypes.POINTER(lr_structure),
    )),
    "lr_structure_nbytes": (ctypes.c_uint64, (
        ctypes.POINTER(lr_structure),
    )),
    "lr_structure_has_tree": (ctypes.c_int32, (
        ctypes.POINTER(lr_structure),
    )),
    "lr_structure_bounds": (None, (
        ctypes.POINTER(lr_structure),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_double),
    )),
    "lr_trace": (ctypes.c_int, (
        ctypes.POINTER(lr_structure),
        ctypes.POINTER(lr_rays),
        ctypes.c_uint64,
        ctypes.POINTER(lr_trace_options),
        ctypes.POINTER(lr_hits),
        ctypes.POINTER(lr_counters),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_scene_new": (ctypes.c_int, (
        ctypes.POINTER(lr_scene_desc),
        ctypes.POINTER(ctypes.POINTER(lr_scene)),
        ctypes.POINTER(lr_error),
    )),
    "lr_scene_free": (None, (
        ctypes.POINTER(lr_scene),
    )),
    "lr_render_nbytes": (ctypes.c_uint64, (
        ctypes.POINTER(lr_scene),
        ctypes.c_int32,
        ctypes.c_int32,
        ctypes.c_int32,
    )),
    "lr_render_tile": (ctypes.c_int, (
        ctypes.POINTER(lr_scene),
        ctypes.POINTER(lr_tile),
        ctypes.POINTER(lr_passes),
        ctypes.c_void_p,
        ctypes.c_uint64,
        ctypes.POINTER(lr_counters),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_image_method_count": (ctypes.c_int32, ()),
    "lr_image_method_get": (ctypes.c_int, (
        ctypes.c_int32,
        ctypes.POINTER(lr_image_method),
        ctypes.POINTER(lr_error),
    )),
    "lr_prepare": (ctypes.c_int, (
        ctypes.POINTER(lr_volume),
        ctypes.c_int32,
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(ctypes.POINTER(lr_prepared)),
        ctypes.POINTER(lr_error),
    )),
    "lr_prepared_free": (None, (
        ctypes.POINTER(lr_prepared),
    )),
    "lr_prepared_nbytes": (ctypes.c_uint64, (
        ctypes.POINTER(lr_prepared),
    )),
    "lr_prepared_light": (ctypes.c_int, (
        ctypes.POINTER(lr_prepared),
        ctypes.c_int32,
        ctypes.POINTER(lr_image_light),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
    "lr_prepared_voxel_count": (ctypes.c_uint64, (
        ctypes.POINTER(lr_prepared),
    )),
    "lr_prepared_voxels": (None, (
        ctypes.POINTER(lr_prepared),
        ctypes.POINTER(ctypes.c_int32),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_double),
        ctypes.POINTER(ctypes.c_uint32),
    )),
    "lr_render_image": (ctypes.c_int, (
        ctypes.POINTER(lr_prepared),
        ctypes.POINTER(lr_camera),
        ctypes.POINTER(lr_frame_before),
        ctypes.POINTER(lr_image),
        ctypes.POINTER(lr_counters),
        ctypes.POINTER(lr_watch),
        ctypes.POINTER(lr_error),
    )),
}

ABOUT = {
    "LR_E_ARGUMENT": "an argument out of its range",
    "LR_E_SIZE": "more than the format or the given buffer holds",
    "LR_E_MEMORY": "the system gave no memory",
    "LR_E_STOPPED": "the caller's stop word was set",
    "LR_U8": "one byte per sample: smallest, for previews",
    "LR_U16": "two bytes per sample: as good as exact for most scenes",
    "LR_F32": "four bytes per sample: for measurements",
    "LR_KIND_AUTO": "a solid where the mesh is closed, a sheet where it is open",
    "LR_KIND_SOLID": "what the mesh encloses",
    "LR_KIND_SHEET": "the surface alone, without an inside",
    "LR_VOLUME_LINEAR": "trilinear: passes through the samples, and bends at the faces of cells",
    "LR_VOLUME_CUBIC": "tricubic B-spline: smooth, without facets; rounds what is as fine as the samples, and takes longer",
    "LR_OP_MULTIPLY_ADD": "a * b + c",
    "LR_OP_LOGARITHM": "of a to the base b",
    "LR_OP_LESS_THAN": "1 or 0, as those that follow",
    "LR_OP_COMPARE": "a and b differ by c at most",
    "LR_OP_SMOOTH_MIN": "within the distance c",
    "LR_OP_MODULO": "of a's sign",
    "LR_OP_WRAP": "a into the range from c to b",
    "LR_OP_SELECT": "a is not 0: b, else c",
    "LR_OP_TABLE": "a looked up in table b of the program",
    "LR_TABLE_LINEAR": "between the values of 0..1, the ends beyond",
    "LR_TABLE_CONSTANT": "the value before",
    "LR_TABLE_EXTRAPOLATE": "linear, and on in the direction of its ends",
    "LR_INTERPOLATION_CUBIC": "a B-spline, which smooths",
    "LR_EXTENSION_EXTEND": "the colour of the edge",
    "LR_EXTENSION_CLIP": "black",
    "LR_COLOR_NONE": "white",
    "LR_COLOR_VERTEX": "corner_colors; from 0 on: the texture of that number",
    "LR_FILTER_RAMP": "linear in the distance to the surface",
    "LR_FILTER_BOX": "the exact share of the voxel that is inside",
    "LR_FILTER_CONE": "the hypercone of Wang and Kaufman: soft",
    "LR_FILTER_GAUSS": "Gaussian: soft",
    "LR_FILTER_BINARY": "inside or outside, nothing between",
    "LR_SIMD_AUTO": "the best that processor and system offer",
    "LR_EXACT_SHEETS": "those of open surfaces",
    "LR_EXACT_ALL": "those of solids too: sharper, and larger",
    "LR_EXACT_NONE": "none: a sheet ends with the cells that it touches",
    "LR_EXACT_EVERY": "all cells that the surface meets: there is no error",
    "LR_STAGE_COMPONENTS": "where winding numbers tell inside from outside: which samples go together",
    "LR_STAGE_WINDING": "and what their winding numbers are",
    "LR_STAGE_CELLS": "triangle cells, where wanted",
    "LR_REASON_ASKED": "the options say so",
    "LR_REASON_CLOSED": "solid: every edge has two triangles of one winding",
    "LR_REASON_CROSSING": "solid, closed too, but parts cross or lie in each other",
    "LR_REASON_ENCLOSES": "solid: not closed, but it encloses a volume; holes are small",
    "LR_REASON_HOLES": "sheet: it has holes that would be seen to be closed",
    "LR_REASON_FLIPPED": "sheet: neighbouring faces disagree in winding",
    "LR_REASON_EMPTY": "sheet: it encloses nothing",
    "LR_METRIC_CHESSBOARD": "the largest of the three differences",
    "LR_METRIC_CITYBLOCK": "their sum",
    "LR_METRIC_CHAMFER345": "steps to a neighbour by face, edge, corner cost 3, 4, 5",
    "LR_TRAVERSER_EXACT": "agrees with the integer oracle but for ties",
    "LR_TRAVERSER_DEFAULT": "set for one of them",
    "LR_TRAVERSER_RECTILINEAR": "takes rectilinear volumes",
    "LR_TRAVERSER_TRIAL": "builds little: worth a trial where the fastest is wanted",
    "LR_MODE_SURFACE": "the first crossing of f = T, in either direction",
    "LR_MODE_BINARY": "the first object cell: largest of its samples >= T",
    "LR_MODE_VOLUME": "emission and absorption along the whole ray",
    "LR_MODE_MAXIMUM": "the largest value along it",
    "LR_MODE_MINIMUM": "the smallest",
    "LR_MODE_MEAN": "the mean of all values along it",
    "LR_SAMPLING_EXACT": "integrals of the field's cubic in each cell, without steps",
    "LR_SAMPLING_POST": "samples of the field, classified: misses what is thinner than a step",
    "LR_SAMPLING_PRE": "samples of classified corners: misses values between these, too, and blurs",
    "LR_HIT_EXTREMA": "also look at the field's extrema inside a cell, so that no surface is lost",
    "LR_HIT_FACES": "look at the field on the faces of cells only: fast, but loses grazing surfaces",
    "LR_HIT_UNIFORM": "look at the field at equal steps along the ray: loses what lies between them",
    "LR_ROOT_NEWTON": "Newton's steps inside a bracket, to full precision",
    "LR_ROOT_BISECT": "halving of a bracket, to full precision: slower",
    "LR_ROOT_CUBIC": "the roots of the cubic in closed form, to full precision",
    "LR_ROOT_LINEAR": "one linear interpolation: fast and approximate",
    "LR_NORMAL_CENTRAL": "central differences, interpolated: smooth",
    "LR_NORMAL_ANALYTIC": "the gradient of the field itself: faceted at cell borders",
    "LR_NORMAL_SMOOTH": "the gradients of the eight cells around, blended: smooth, and slower",
    "LR_NORMAL_SOBEL": "central differences averaged over nine: for noise, and slower",
    "LR_NORMAL_ZUCKER_HUMMEL": "as sobel, by the distance: turns least with the lattice",
    "LR_VISIBLE_SHADOW": "instances: stop light; lights: are stopped by instances",
    "LR_LIGHT_SPOT": "a point light behind a hole, within a cone",
    "LR_LIGHT_AREA": "shines to one side",
    "LR_LIGHT_ROUND": "area: an ellipse; point and spot: a disc that faces what it lights",
    "LR_LIGHT_FULL": "area: a parallelogram; point and spot: a sphere",
    "LR_LOBE_DIFFUSE": "Lambert's law",
    "LR_LOBE_GLOSSY": "GGX microfacets that reflect color",
    "LR_LOBE_GLASS": "GGX microfacets of a dielectric: reflect and refract, times color",
    "LR_LOBE_REFRACTION": "refract all but what is reflected totally, which is lost",
    "LR_LOBE_TRANSPARENT": "color goes straight through",
    "LR_LOBE_EMISSION": "shines with the radiance color",
    "LR_LOBE_PRINCIPLED": "Blender's Principled BSDF, without sheen, coat, subsurface, film",
    "LR_LOBE_TEXTURED": "the volume's colours multiply color",
    "LR_LOBE_MULTISCATTER": "light between microfacets is not lost",
    "LR_PHASE_RAYLEIGH": "of particles much smaller than the light's wavelength",
    "LR_FIELD_ID": "no colour: the id, and so the material, that weighs most among the samples inside, averaged by 1-2-1 along each axis",
    "LR_FILM_BOX": "the mean over the pixel itself: sharp edges",
    "LR_FILM_BLACKMAN_HARRIS": "Cycles' own: smooth edges, no stair steps",
    "LR_RAY_CAMERA": "by none",
    "LR_RAY_TRANSPARENT": "straight through",
    "LR_RAY_VOLUME": "scattered within a volume",
    "LR_EVENT_RAY": "a path starts its next ray",
    "LR_EVENT_HIT": "that ray has ended, at a surface or nowhere",
    "LR_EVENT_LIGHT": "a surface samples a light",
    "LR_EVENT_FOUND": "a ray meets a light, the world, or a surface that shines",
    "LR_EVENT_SCATTER": "a volume scatters light before that end",
    "LR_IMAGE_EXACT": "cells and t are those of lr_trace in LR_MODE_BINARY, cell by cell",
    "LR_IMAGE_PERSPECTIVE": "takes perspective cameras, too; all take orthographic ones",
    "LR_IMAGE_SURFACES": "shows the first object cells",
    "LR_IMAGE_LIGHTS": "shades by lights (lr_prepared_light) and gives normals; others shade by depth",
    "LR_IMAGE_FRAMES": "takes the frame before, and is faster with it",
    "LR_PIXEL_SKIPPED": "a miss that was known without a ray of its own",
}
