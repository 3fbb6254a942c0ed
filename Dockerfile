# The engine on the CPU, as the command `dgs`:
#     docker build -t dgs .
#     docker run --rm -v "$PWD:/data" dgs reconstruct /data/photos --out /data/twin --psf gaussian:5
FROM python:3.11-slim
# torch for the CPU: the one of the ordinary index brings gigabytes for a card. Its page "Get started" names the index.
ARG TORCH_INDEX
# libgomp: numba's and torch's threads; libgl1, libglib2.0: pycolmap links to them.
RUN apt-get update \
 && apt-get install -y --no-install-recommends libgomp1 libgl1 libglib2.0-0 \
 && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY . .
RUN if [ -n "$TORCH_INDEX" ]; then pip install --no-cache-dir torch==2.13.0 --index-url "$TORCH_INDEX"; fi \
 && pip install --no-cache-dir . -c requirements.lock \
 && rm -rf /source/*
# A spinning thread starves whoever shares the machine; kernels are compiled once and kept in a volume of this name.
ENV OMP_WAIT_POLICY=passive XDG_CACHE_HOME=/cache
VOLUME /cache
WORKDIR /data
ENTRYPOINT ["dgs"]
