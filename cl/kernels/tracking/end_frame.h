// The end of a frame. Define: N_DOF.
#if !defined(N_DOF)
#error "tracking/end_frame.h needs N_DOF"
#endif

// What to add to the particles before the next frame: how far the estimate was moved after the mean
// was taken (shift), and its velocity, which is a share of the velocity before and `velocity` times
// the change since the last frame.
// motion: N_DOF x (last estimate, what to add, velocity, share of it that stays).
// report: all that the host reads: result (n_result), information (n_information), candidates of
// the limb search (n_candidates) and their errors (n_errors), misfit.
typedef struct {
    float velocity;
    int n_result, n_information, n_candidates, n_errors;
    __global const uint *frame;
    __global const float *result, *shift, *information, *candidates, *errors, *misfit;
    __global float4 *motion;
    __global float *report;
} frame_end;

// One number of the report, and of what to add.
static inline void report_item(const frame_end *end, int id)
{
    int at = id;
#define REPORT(values, n) \
    if (at >= 0 && at < n) end->report[id] = values[at]; \
    at -= n;
    REPORT(end->result, end->n_result)
    REPORT(end->information, end->n_information)
    REPORT(end->candidates, end->n_candidates)
    REPORT(end->errors, end->n_errors)
    REPORT(end->misfit, 1)
#undef REPORT
    if (id >= N_DOF) return;
    const float pose = end->result[id];
    // The first frame's change is the start's error, not a motion.
    const float4 last = end->motion[id];
    const float change = *end->frame > 1 ? pose - last.x : 0.0f;
    const float velocity = last.w * last.z + end->velocity * change;
    end->motion[id] = (float4)(pose, end->shift[id] + velocity, velocity, last.w);
}
