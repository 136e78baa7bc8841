// What the host reads after a frame, gathered for one download; twin: none, it only copies.

// report: result (n_result), information (n_information), misfits (n_misfits).
__kernel void gather(int n_result, int n_information, int n_misfits, __global const float *result,
                     __global const float *information, __global const float *misfits,
                     __global float *report)
{
    const int id = get_global_id(0), place = id - n_result - n_information;
    if (id < n_result) report[id] = result[id];
    else if (place < 0) report[id] = information[id - n_result];
    else if (place < n_misfits) report[id] = misfits[place];
}
