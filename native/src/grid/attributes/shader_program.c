/* Programs: the operations of shader nodes, one after the other on registers.
 *
 * What a node makes of a texture must be made at every look, of the interpolated colour:
 * a steep ramp of interpolated colours is sharp, interpolated colours of a ramp are not.
 *
 * Source: Blender's manual, Math node, says what an operation is; at the edges of its
 * domain it has the value that Cycles gives it, found by rendering.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/attributes/shader_program.h"

#include <float.h>

#include "base/error.h"

static float divide(float a, float b)
{
    return b != 0.0f ? a / b : 0.0f;
}

static float power(float a, float b)
{
    if (b == 0.0f)
        return 1.0f;
    if (a == 0.0f || (a < 0.0f && b != truncf(b)))
        return 0.0f;
    return powf(a, b);
}

static float smooth_min(float a, float b, float k)
{
    if (k == 0.0f)
        return fminf(a, b);
    const float h = fmaxf(k - fabsf(a - b), 0.0f) / k;
    return fminf(a, b) - h * h * h * k / 6.0f;
}

static float wrap(float a, float high, float low)
{
    const float range = high - low;
    return range != 0.0f ? a - range * floorf((a - low) / range) : low;
}

static float pingpong(float a, float b)
{
    const float turns = (a - b) / (2.0f * b);
    return b != 0.0f ? fabsf((turns - floorf(turns)) * b * 2.0f - b) : 0.0f;
}

static float from_srgb(float x)
{
    return x < 0.04045f ? fmaxf(x, 0.0f) / 12.92f : powf((x + 0.055f) / 1.055f, 2.4f);
}

float lr_operate(int32_t operation, float a, float b, float c)
{
    switch (operation) {
    case LR_OP_ADD:
        return a + b;
    case LR_OP_SUBTRACT:
        return a - b;
    case LR_OP_MULTIPLY:
        return a * b;
    case LR_OP_DIVIDE:
        return divide(a, b);
    case LR_OP_MULTIPLY_ADD:
        return a * b + c;
    case LR_OP_POWER:
        return power(a, b);
    case LR_OP_LOGARITHM:
        return a > 0.0f && b > 0.0f ? divide(logf(a), logf(b)) : 0.0f;
    case LR_OP_SQRT:
        return sqrtf(fmaxf(a, 0.0f));
    case LR_OP_INVERSE_SQRT:
        return a > 0.0f ? 1.0f / sqrtf(a) : 0.0f;
    case LR_OP_ABSOLUTE:
        return fabsf(a);
    case LR_OP_EXPONENT:
        return expf(a);
    case LR_OP_MINIMUM:
        return fminf(a, b);
    case LR_OP_MAXIMUM:
        return fmaxf(a, b);
    case LR_OP_LESS_THAN:
        return a < b;
    case LR_OP_GREATER_THAN:
        return a > b;
    case LR_OP_COMPARE:
        return a == b || fabsf(a - b) <= fmaxf(c, FLT_EPSILON);
    case LR_OP_SIGN:
        return (float)((a > 0.0f) - (a < 0.0f));
    case LR_OP_SMOOTH_MIN:
        return smooth_min(a, b, c);
    case LR_OP_ROUND:
        return floorf(a + 0.5f);
    case LR_OP_FLOOR:
        return floorf(a);
    case LR_OP_CEIL:
        return ceilf(a);
    case LR_OP_TRUNC:
        return truncf(a);
    case LR_OP_FRACT:
        return a - floorf(a);
    case LR_OP_MODULO:
        return b != 0.0f ? fmodf(a, b) : 0.0f;
    case LR_OP_FLOORED_MODULO:
        return b != 0.0f ? a - floorf(a / b) * b : 0.0f;
    case LR_OP_WRAP:
        return wrap(a, b, c);
    case LR_OP_PINGPONG:
        return pingpong(a, b);
    case LR_OP_SINE:
        return sinf(a);
    case LR_OP_COSINE:
        return cosf(a);
    case LR_OP_TANGENT:
        return tanf(a);
    case LR_OP_ARCSINE:
        return asinf(fmaxf(-1.0f, fminf(a, 1.0f)));
    case LR_OP_ARCCOSINE:
        return acosf(fmaxf(-1.0f, fminf(a, 1.0f)));
    case LR_OP_ARCTANGENT:
        return atanf(a);
    case LR_OP_ARCTAN2:
        return a == 0.0f && b == 0.0f ? 0.0f : atan2f(a, b);
    case LR_OP_SINH:
        return sinhf(a);
    case LR_OP_COSH:
        return coshf(a);
    case LR_OP_TANH:
        return tanhf(a);
    case LR_OP_SELECT:
        return a != 0.0f ? b : c;
    case LR_OP_FROM_SRGB:
        return from_srgb(a);
    default:
        return NAN;
    }
}

static float look_up(const lr_program *p, const lr_table *table, float x)
{
    const float *v = p->values + table->first;
    const uint32_t last = table->n - 1;
    if (table->kind == LR_TABLE_EXTRAPOLATE && x < 0.0f)
        return v[0] + (v[1] - v[0]) * x * (float)last;
    if (table->kind == LR_TABLE_EXTRAPOLATE && x > 1.0f)
        return v[last] + (v[last] - v[last - 1]) * (x - 1.0f) * (float)last;
    const float at = (float)lr_clamp((double)x, 0.0, 1.0) * (float)last;
    const uint32_t i = (uint32_t)at;
    const float share = at - (float)i;
    if (table->kind == LR_TABLE_CONSTANT || !(share > 0.0f))
        return v[i];
    return (1.0f - share) * v[i] + share * v[i + 1];
}

LR_INLINE float operand(const lr_program *p, const float *registers, uint16_t i)
{
    return i < LR_PROGRAM_REGISTERS ? registers[i] : p->constants[i - LR_PROGRAM_REGISTERS];
}

void lr_program_color(const lr_program *p, const float rgba[4], float rgb[3])
{
    float registers[LR_PROGRAM_REGISTERS];
    memcpy(registers, rgba, 4 * sizeof *registers);
    for (uint64_t k = 0; k < p->n_instructions; k++) {
        const lr_instruction *i = &p->instructions[k];
        const float a = operand(p, registers, i->a);
        registers[i->to] = i->operation == LR_OP_TABLE
                               ? look_up(p, &p->tables[i->b], a)
                               : lr_operate(i->operation, a, operand(p, registers, i->b),
                                            operand(p, registers, i->c));
    }
    for (int k = 0; k < 3; k++)
        rgb[k] = operand(p, registers, p->outputs[k]);
}

/* Whether an operand is a constant that is there, or a register that has been set. */
static bool is_set(const lr_program *p, const bool *set, uint16_t operand)
{
    if (operand < LR_PROGRAM_REGISTERS)
        return set[operand];
    return operand - (uint64_t)LR_PROGRAM_REGISTERS < p->n_constants;
}

lr_status lr_program_check(const lr_program *p, lr_error *error)
{
    bool set[LR_PROGRAM_REGISTERS] = {true, true, true, true};
    for (uint64_t t = 0; t < p->n_tables; t++) {
        const lr_table *table = &p->tables[t];
        if (table->n < 2 || table->first > p->n_values || table->n > p->n_values - table->first)
            return lr_fail(error, LR_E_SIZE, "table %u of a program has values %u to %u of %u",
                           (unsigned)t, table->first, table->first + table->n,
                           (unsigned)p->n_values);
        if (table->kind < LR_TABLE_LINEAR || table->kind > LR_TABLE_EXTRAPOLATE)
            return lr_fail(error, LR_E_ARGUMENT, "table %u of a program is of no kind (%d)",
                           (unsigned)t, table->kind);
    }
    for (uint64_t k = 0; k < p->n_instructions; k++) {
        const lr_instruction *i = &p->instructions[k];
        const bool looks = i->operation == LR_OP_TABLE;
        if (i->operation > LR_OP_TABLE || i->to >= LR_PROGRAM_REGISTERS || !is_set(p, set, i->a) ||
            (looks ? i->b >= p->n_tables : !is_set(p, set, i->b) || !is_set(p, set, i->c)))
            return lr_fail(error, LR_E_ARGUMENT,
                           "instruction %u of a program, %d(%d, %d, %d) to %d, names what is not "
                           "there",
                           (unsigned)k, i->operation, i->a, i->b, i->c, i->to);
        set[i->to] = true;
    }
    for (int k = 0; k < 3; k++)
        if (!is_set(p, set, p->outputs[k]))
            return lr_fail(error, LR_E_ARGUMENT, "output %d of a program names what is not there",
                           k);
    return LR_OK;
}

lr_status lr_program_run(const lr_program *program, const float *inputs, uint64_t n, float *outputs,
                         lr_error *error)
{
    const lr_status status = lr_program_check(program, error);
    for (uint64_t i = 0; i < n && status == LR_OK; i++)
        lr_program_color(program, inputs + 4 * i, outputs + 3 * i);
    return status;
}
