// What the host reads after a frame, gathered for one download; twin: none, it only copies.

// report: result (n_result), information (n_information), misfit (1).
__kernel void gather(int n_result, int n_information, __global const float *result,
                     __global const float *information, __global const float *misfit,
                     __global float *report)
{
    const int id = get_global_id(0);
    if (id < n_result) report[id] = result[id];
    else if (id < n_result + n_information) report[id] = information[id - n_result];
    else if (id == n_result + n_information) report[id] = misfit[0];
}
