# The node `sim` on ROS 2 Jazzy (Ubuntu 24.04, Python 3.12), with all kernels compiled.
#   docker build -t procphys_ros . && docker run --rm --net=host --ipc=host procphys_ros
# Kernels fit the CPU of the machine that builds; on another one the node compiles its own.

FROM ros:jazzy-ros-base AS build
RUN apt-get update && apt-get install -y --no-install-recommends python3-venv
COPY . /src
RUN python3 -m venv --system-site-packages /opt/procphys_ros \
 && /opt/procphys_ros/bin/pip install --no-cache-dir /src

FROM ros:jazzy-ros-base
COPY --from=build /opt/procphys_ros /opt/procphys_ros
ENV NUMBA_CACHE_DIR=/opt/procphys_ros/kernels
RUN /opt/procphys_ros/bin/python -m procphys_ros.warm
CMD ["/opt/procphys_ros/lib/procphys_ros/sim", "--ros-args", \
     "--params-file", "/opt/procphys_ros/share/procphys_ros/config/demo.yaml"]
