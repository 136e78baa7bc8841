# docker build -t psfs-apf . ; docker run --rm -v "$PWD:/data" psfs-apf apf demo -o demo
# OpenCL on the CPU by PoCL. For an NVIDIA GPU: docker run --gpus all -e NVIDIA_DRIVER_CAPABILITIES=compute,utility ...
FROM python:3.12-slim
COPY pyproject.toml README.md LICENSE /source/
COPY cl /source/cl
COPY psfs /source/psfs
COPY apf /source/apf
RUN pip install --no-cache-dir "/source[studio,mesh]" \
    && mkdir -p /etc/OpenCL/vendors \
    && echo libnvidia-opencl.so.1 > /etc/OpenCL/vendors/nvidia.icd
WORKDIR /data
EXPOSE 8090
CMD ["apf", "--help"]
