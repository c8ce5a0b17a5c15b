# The images of the services, one target each. compose.yaml builds them with the extras of pyproject.toml that each needs
# (EXTRA; several with commas), and compose.gpu.yaml builds the render service for NVIDIA GPUs: wheels only, no CUDA toolkit,
# no compiler.
ARG PYTHON_IMAGE=python:3.11-slim-bookworm
ARG NODE_IMAGE=node:20-slim

FROM ${NODE_IMAGE} AS page
WORKDIR /src/web
COPY web/package.json web/package-lock.json web/.npmrc ./
RUN --mount=type=secret,id=ca,target=/run/ca.crt --mount=type=cache,target=/root/.npm \
    if [ -s /run/ca.crt ]; then export NODE_EXTRA_CA_CERTS=/run/ca.crt; fi; \
    npm ci --no-audit --no-fund --loglevel=error
COPY web ./
RUN npm run --silent build

# uv and the package's build tools, at the versions of uv.lock.
FROM ${PYTHON_IMAGE} AS uv
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore UV_LINK_MODE=copy UV_PYTHON_DOWNLOADS=never
WORKDIR /src
COPY pyproject.toml uv.lock ./
COPY deploy/uv_requirement.py deploy/
RUN --mount=type=secret,id=ca,target=/run/ca.crt --mount=type=cache,target=/root/.cache \
    if [ -s /run/ca.crt ]; then export PIP_CERT=/run/ca.crt SSL_CERT_FILE=/run/ca.crt; fi; \
    python deploy/uv_requirement.py >/uv.txt && pip install -q --require-hashes -r /uv.txt \
    && uv export -q --frozen --only-group build --output-file /build.txt \
    && uv pip install -q --system --require-hashes -r /build.txt

FROM uv AS wheel
COPY README.md LICENSE ./
COPY services services
RUN uv build -q --wheel --no-build-isolation --out-dir /wheel

# An environment with only the packages that a service runs with: no pip, build tools or tests.
FROM uv AS build
RUN python -m venv --without-pip /opt/tigas
# Dependencies first, so that a change in our code does not reinstall them. WITHOUT: packages of the extras that a service
# does not need.
ARG EXTRA
ARG WITHOUT=
RUN --mount=type=secret,id=ca,target=/run/ca.crt --mount=type=cache,target=/root/.cache \
    if [ -s /run/ca.crt ]; then export SSL_CERT_FILE=/run/ca.crt; fi; \
    : ${EXTRA:?which extra of pyproject.toml? See compose.yaml}; \
    uv export -q --frozen --no-default-groups --no-emit-project $(printf ' --extra %s' $(echo ${EXTRA} | tr , ' ')) \
        ${WITHOUT:+$(printf ' --prune %s' $(echo ${WITHOUT} | tr , ' '))} --output-file /dependencies.txt \
    && uv pip install -q --python /opt/tigas/bin/python --require-hashes -r /dependencies.txt \
    && find /opt/tigas/lib -type d -name tests -prune -exec rm -r {} +
RUN --mount=type=bind,from=wheel,source=/wheel,target=/wheel \
    uv pip install -q --python /opt/tigas/bin/python --no-deps /wheel/*.whl

FROM build AS build-with-page
RUN --mount=type=bind,from=page,source=/src/services/render/tigas_render/static,target=/page \
    cp -r /page "$(/opt/tigas/bin/python -c 'import tigas_render; print(tigas_render.__path__[0])')/static"

FROM ${PYTHON_IMAGE} AS service
RUN useradd --uid 10001 --no-create-home tigas
ENV PATH=/opt/tigas/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
# The render service's first start compiles its rasteriser.
HEALTHCHECK --interval=5s --timeout=3s --start-period=180s --retries=3 \
    CMD ["python", "-c", "import os, urllib.request; urllib.request.urlopen(os.environ['HEALTH_URL'], timeout=2)"]

# The render service, with the page.
FROM service AS render
COPY --from=build-with-page /opt/tigas /opt/tigas
# Code compiled for this machine's processor is kept in /cache, the only writable place.
RUN install -d -o tigas /cache /models
ENV XDG_CACHE_HOME=/cache NUMBA_CACHE_DIR=/cache/numba TIGAS_RENDER_SCENES=/models \
    TIGAS_RENDER_HTTP=0.0.0.0:8080 TIGAS_RENDER_HTTPS=0.0.0.0:8443 TIGAS_RENDER_QUIC=0.0.0.0:4433 \
    HEALTH_URL=http://127.0.0.1:8080/healthz
# The commit of the build, for experiment records.
ARG TIGAS_COMMIT=
ENV TIGAS_COMMIT=${TIGAS_COMMIT}
USER tigas
WORKDIR /cache
EXPOSE 8080 8443 4433/udp
ENTRYPOINT ["tigas", "render"]

# A machine of a cluster, its head (tigas-head) or a host (ray start): compose.cluster.yaml and deploy/kuberay.yaml run it.
FROM render AS cluster
COPY --chmod=755 deploy/head.sh /usr/local/bin/tigas-head
# Ray reports no statistics, keeps few logs, because they are in memory, and stops at once when asked: viewers do not need
# half a minute to move.
ENV TIGAS_RENDER_HTTPS=off RAY_GRACEFUL_SHUTDOWN_DRAIN_TIMEOUT_S=0 \
    RAY_USAGE_STATS_ENABLED=0 RAY_ROTATION_MAX_BYTES=4000000 RAY_ROTATION_BACKUP_COUNT=1
ENTRYPOINT []

# The DASH packager.
FROM service AS dash-packager
COPY --from=build /opt/tigas /opt/tigas
ENV TIGAS_DASH_HTTP=0.0.0.0:8081 HEALTH_URL=http://127.0.0.1:8081/healthz
ARG TIGAS_COMMIT=
ENV TIGAS_COMMIT=${TIGAS_COMMIT}
USER tigas
EXPOSE 8081 8081/udp
ENTRYPOINT ["tigas", "dash"]

# The experiment store.
FROM service AS store
COPY --from=build /opt/tigas /opt/tigas
COPY traces/movement /movements
# Only results are kept; matplotlib needs a place for its cache.
RUN install -d -o tigas /results
ENV MPLCONFIGDIR=/tmp/matplotlib TIGAS_STORE_RESULTS=/results TIGAS_STORE_MOVEMENTS=/movements \
    TIGAS_STORE_HTTP=0.0.0.0:8091 HEALTH_URL=http://127.0.0.1:8091/healthz
ARG TIGAS_COMMIT=
ENV TIGAS_COMMIT=${TIGAS_COMMIT}
USER tigas
WORKDIR /results
EXPOSE 8091
ENTRYPOINT ["tigas", "store"]

# The shaper: the router hop between clients and services. It configures the network, so it runs as root, with only
# the capability that this needs (NET_ADMIN).
FROM service AS shaper
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends iproute2 nftables ethtool >/dev/null \
    && rm -rf /var/lib/apt/lists/* /var/cache/apt/*
COPY --from=build /opt/tigas /opt/tigas
COPY traces/network /traces
ENV TIGAS_SHAPER_TRACES=/traces TIGAS_SHAPER_HTTP=0.0.0.0:8090 HEALTH_URL=http://127.0.0.1:8090/healthz
ARG TIGAS_COMMIT=
ENV TIGAS_COMMIT=${TIGAS_COMMIT}
EXPOSE 8090
ENTRYPOINT ["tigas", "shaper"]
